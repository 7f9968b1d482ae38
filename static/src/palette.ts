// Colours of data. Grades, causes and missed area are those of the report, which readers with colour deficiencies tell apart
// (`src/report/html/palette.rs`): a picture of grades has one colour for all that is missed, one of causes a colour for each group.
export type Rgb = [number, number, number];

const rgb = (hex: string): Rgb => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16)) as Rgb;
export const css = ([r, g, b]: Rgb): string => `rgb(${r} ${g} ${b})`;

export const GRADES: Record<string, Rgb> = { A: rgb("#0018b1"), B: rgb("#19dd7c"), C: rgb("#ffef14"), D: rgb("#b33107") };
const CAUSES: [RegExp, Rgb][] = [
  [/^shadow_/, rgb("#1d62e8")],
  [/^(incidence_|exposure$|below_grade$)/, rgb("#ae7300")],
  [/^facing$/, rgb("#12e58b")],
  [/^frame_/, rgb("#542c00")],
  [/^depth$/, rgb("#f7f704")],
  [/^(unreachable|collision|hidden_by_cell|no_path)$/, rgb("#45004d")],
  [/^(excluded_resting|faces_table|enclosed)$/, rgb("#0000ee")],
  [/^(not_chosen|at_risk)$/, rgb("#00b2ef")],
];
export const MISSED = rgb("#e564e4");
export const NOT_ASKED: Rgb = rgb("#5a5c5a");
/** Measured, where causes are told apart. */
export const PLAIN: Rgb = rgb("#dcdae5");
export const MARKED: Rgb = rgb("#ff8c00");
/** Of scans: planned and not measured; measured; not asked for. */
export const LOST = rgb("#d55e00");
export const WHOLE: Rgb = rgb("#a8bacc");
export const UNASKED: Rgb = rgb("#c9ccd1");
export const causeColour = (cause: string): Rgb => CAUSES.find(([names]) => names.test(cause))?.[1] ?? MISSED;

/** Viewpoints in lists and in 3D. */
const VIEWS = { planned: rgb("#2f78c4"), chosen: rgb("#e69f00"), unused: rgb("#9aa2ac"), added: rgb("#00a37a") };
export const viewColour = (view: { isUsed: boolean; isAdded: boolean }, isChosen: boolean): Rgb =>
  VIEWS[isChosen ? "chosen" : !view.isUsed ? "unused" : view.isAdded ? "added" : "planned"];

/** Scale from dark to light, cividis in five stops. */
const SCALE = ["#00224e", "#3b496c", "#7c7b78", "#bcaf6f", "#fee838"].map(rgb);
export function onScale(share: number): Rgb {
  const at = Math.max(0, Math.min(0.9999, share)) * (SCALE.length - 1);
  const [low, high] = [SCALE[Math.floor(at)]!, SCALE[Math.floor(at) + 1]!];
  return low.map((value, i) => Math.round(value + (high[i]! - value) * (at % 1))) as Rgb;
}

/** Devices: left and right camera, projector. */
export const DEVICES: Record<string, Rgb> = { left: rgb("#0072b2"), right: rgb("#009e73"), projector: rgb("#e69f00") };
/** Lines of plots. */
export const LINES = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8a8f98"];

/** Causes of losses, after Okabe and Ito; two that share a hue differ in lightness. */
const LOSSES: Record<string, Rgb> = {
  view_missing: rgb("#0072b2"), outside_file: rgb("#7db8e0"), pose: rgb("#e69f00"), unmodelled_occluder: rgb("#d55e00"), part_deviates: rgb("#cc4b97"),
  grazing: rgb("#f0e442"), specular: rgb("#56b4e9"), edge: rgb("#009e73"), concave: rgb("#005f45"), dark: rgb("#3b3230"), saturated: rgb("#f3b0a5"),
  depth_blur: rgb("#8f6a1f"), sparse: rgb("#9a63c9"), noisy: rgb("#5b3587"), filtered: rgb("#77797d"), unexplained: rgb("#a01818"),
};
export const lossColour = (cause: string): Rgb => LOSSES[cause] ?? LOST;
/** Where the plan and the scans agree and where not. */
export const MATCH: Record<string, Rgb> = { both: rgb("#2f78c4"), lost: LOST, gained: rgb("#00a37a"), neither: rgb("#5b6068"), not_asked: UNASKED };
/** Which of two plans measure a face. */
export const DIFFERENCES = { both: WHOLE, first: rgb("#0072b2"), second: rgb("#d55e00"), neither: rgb("#3d4148"), not_asked: rgb("#f0f1f3") };
/** Below a threshold, or not planned. */
export const BELOW: Rgb = [214, 205, 196];
export const UNMEASURED: Rgb = [128, 132, 138];

const DIVERGING = ["#2166ac", "#f7f7f7", "#b2182b"].map(rgb);
/** Deviation in units of the limit: blue for missing material, red for extra, as in the report (ends and middle of ColorBrewer's RdBu). */
export function diverging(place: number): Rgb {
  const at = Math.max(-1, Math.min(1, place)) + 1;
  const low = Math.min(1, Math.floor(at));
  return DIVERGING[low]!.map((value, i) => Math.round(value + (DIVERGING[low + 1]![i]! - value) * (at - low))) as Rgb;
}

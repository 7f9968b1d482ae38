// The plan on the part: coverage by colour, views and their frustums, why a spot is missed and what helps, regions drawn on the
// part, views changed by hand and re-scored at once.
import { useSignal, useComputed, batch, type Signal } from "@preact/signals";
import { useEffect, useMemo, useRef, useState } from "preact/hooks";
import type { Box3 } from "three";
import type { Job, Spot } from "./api";
import { meaningOf } from "./bytes";
import { length, percent, visits } from "./settings";
import { planAgain } from "./joblist";
import { Tracer } from "./mesh";
import {
  areasBy, editedViews, editsOf, isEdited, lookingAt, modelOf, moved, plannedViews, plateOf, shownSetup, STILL, tableFromPart, type EditedView, type Model,
} from "./planmodel";
import { ChartsPanel, Legend, MissesPanel, RegionsPanel, SpotPanel, SummaryPanel, ViewsPanel } from "./planpanels";
import { lyingBox, OPEN, painter, PlanScene, sectionAt, type Colouring, type SectionAxis, type Threshold } from "./planscene";
import { matrixOf } from "./poses";
import { Stage, type PointerPick } from "./stage";
import { text } from "./text";
import { Button, known, message, Pending, Select, Slider, Tabs, useLoaded } from "./widgets";
import { View3d } from "./view3d";
import type { Hit, Judgement, Scores } from "./worker";

export interface SpotState { hit: Hit; judgements: Judgement[]; meaning: string; spot: Spot | null; reason: string | null }
export type RegionTool = "faces" | "brush" | "box";

/** State of one plan view, shared by its panels. */
export interface Plan3d {
  model: Model; tracer: Tracer; views: Signal<EditedView[]>; chosen: Signal<number | null>; scores: Signal<Scores | null>;
  plannedScores: Signal<Scores | null>; computing: Signal<number | null>; spot: Signal<SpotState | null>; marked: Signal<Set<number>>;
  tool: Signal<RegionTool>; sharp: Signal<number>; radius: Signal<number>; box: Signal<{ min: number[]; max: number[] } | null>;
  hovered: Signal<number | null>; chooseView: (id: number | null) => void; askAt: (hit: Hit | null) => Promise<void>; addView: () => void; showSpot: (spot: Spot, reason: string) => Promise<Hit | null>;
  score: (scored?: EditedView[]) => Promise<void>; apply: (set: Record<string, unknown>) => Promise<void>;
}

type Query = { query: URLSearchParams; setQuery: (changes: Record<string, string | undefined>) => void };

export function PlanView({ job, query, setQuery }: { job: Job } & Query) {
  const { value: model, error } = useLoaded(() => modelOf(job), [job.id]);
  if (error || !model) return <Pending error={error} />;
  return <Loaded key={job.id} job={job} model={model} query={query} setQuery={setQuery} />;
}

function usePlan3d(model: Model, { query, setQuery }: Query): Plan3d {
  const tracer = useMemo(() => new Tracer(model.mesh.positions, model.fixture?.positions), [model]);
  useEffect(() => () => tracer.close(), [tracer]);
  const state = {
    views: useSignal<EditedView[]>([]), chosen: useSignal<number | null>(null), hovered: useSignal<number | null>(null), scores: useSignal<Scores | null>(null),
    plannedScores: useSignal<Scores | null>(null), computing: useSignal<number | null>(null), spot: useSignal<SpotState | null>(null),
    marked: useSignal(new Set<number>()), tool: useSignal<RegionTool>("faces"), sharp: useSignal(20), radius: useSignal(5),
    box: useSignal<{ min: number[]; max: number[] } | null>(null),
  };
  // The address says which views are changed and chosen, when the page is opened and whenever another address is entered.
  useMemo(() => batch(() => {
    const view = query.get("view");
    state.views.value = editedViews(model.plan, model.optics.best, query.get("edit"));
    state.chosen.value = view === null ? null : Number(view);
  }), [visits.value]);
  useEffect(() => setQuery({ edit: editsOf(state.views.value) }), [state.views.value]);
  const chooseView = (id: number | null): void => {
    state.chosen.value = id;
    const setup = state.views.peek().find((view) => view.id === id)?.setup;
    // A view is shown with the part as it lies while the view is taken.
    const isHidden = setup !== undefined && query.get("setup") !== "file" && setup !== shownSetup(model.plan, query.get("setup"));
    setQuery({ view: id === null ? undefined : String(id), ...(isHidden && model.plan.cell && { setup: String(setup) }) });
  };
  const score = async (scored?: EditedView[]): Promise<void> => {
    const all = scored ?? state.views.peek();
    const views = all.filter((view) => view.isUsed);
    state.computing.value = 0;
    const made = await tracer.score({ optics: model.optics, views: views.map((view) => view.pose), plates: views.map((view) => plateOf(model, view)) },
      (share) => { state.computing.value = share; }).catch((error: Error) => { [message.value, state.computing.value] = [error.message, null]; return null; });
    if (!made) return;
    batch(() => {
      state.computing.value = null;
      if (!scored) state.scores.value = made;
      if (!isEdited(all)) state.plannedScores.value = made;
    });
  };
  const asked = useRef(0);
  const askAt = async (hit: Hit | null): Promise<void> => {
    const turn = (asked.current += 1);
    if (!hit) { state.spot.value = null; setQuery({ spot: undefined }); return; }
    const views = state.views.peek();
    const judgements = await tracer.judge({ optics: model.optics, views: views.map((view) => view.pose), plates: views.map((view) => plateOf(model, view)),
      point: hit.point, normal: hit.normal });
    // Another spot, or none, was asked for since.
    if (turn !== asked.current) return;
    const missed = model.missedAt(hit.face);
    state.spot.value = { hit, judgements, meaning: meaningOf(model.bytes[hit.face]!), spot: missed?.spot ?? null, reason: missed?.reason ?? null };
    setQuery({ spot: String(hit.face) });
  };
  const showSpot = async (spot: Spot, reason: string): Promise<Hit | null> => {
    const faces = spot.faces.map((source) => model.mesh.faceOf(source)).filter((face) => face >= 0);
    // A face may lie in the spot with a small part only; the one to be shown is missed for this cause, near the spot's middle.
    const own = faces.filter((face) => meaningOf(model.bytes[face]!) === reason);
    const away = (face: number): number => Math.hypot(...hitOf(model, face).point.map((value, i) => value - spot.centre_mm[i]!));
    const nearest = (own.length ? own : faces).reduce<number | null>((best, face) => (best === null || away(face) < away(best) ? face : best), null);
    const hit = nearest === null ? null : hitOf(model, nearest);
    if (hit) await askAt(hit);
    return hit;
  };
  const addView = (): void => {
    const hit = state.spot.peek()?.hit;
    if (!hit) return;
    const views = state.views.peek();
    const id = Math.max(-1, ...views.map((view) => view.id)) + 1;
    const pose = lookingAt(hit.point, hit.normal, model.optics.best);
    state.views.value = [...views, { id, pose, origin: pose, isAdded: true, isUsed: true, wasUsed: false, setup: shownSetup(model.plan, query.get("setup")) ?? 0, move: STILL }];
    chooseView(id);
    void score().then(() => askAt(hit));
  };
  const apply = (set: Record<string, unknown>): Promise<void> => planAgain(model.job.id, set);
  return { model, tracer, ...state, chooseView, askAt, addView, showSpot, score, apply };
}

/** Middle of a face of the preview, as a click on it would give. */
function hitOf(model: Model, face: number): Hit {
  const p = model.mesh.positions.subarray(9 * face, 9 * face + 9) as unknown as number[];
  const point = [0, 1, 2].map((i) => (p[i]! + p[i + 3]! + p[i + 6]!) / 3) as Hit["point"];
  const [ax, ay, az] = [p[3]! - p[0]!, p[4]! - p[1]!, p[5]! - p[2]!];
  const [bx, by, bz] = [p[6]! - p[0]!, p[7]! - p[1]!, p[8]! - p[2]!];
  const n = [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx];
  const size = Math.hypot(...n) || 1;
  return { face, point, normal: n.map((value) => value / size) as Hit["normal"] };
}

function Loaded({ job, model, query, setQuery }: { job: Job; model: Model } & Query) {
  // What is told of the job follows it, as when its warnings are read after its plan.
  const state = { ...usePlan3d(model, { query, setQuery }), model: { ...model, job } };
  const scene = useRef<PlanScene | null>(null);
  const [stage, setStage] = useState<Stage | null>(null);
  const mode = known(text.plan.colours, query.get("colour")) as Colouring;
  const panel = known(text.plan.panels, query.get("panel"));
  const level = query.get("level");
  const threshold: Threshold = { ...OPEN, ...(Number(level) > 0 && { [mode]: Number(level) }) };
  const section = sectionOf(query.get("section"));
  const setup = shownSetup(model.plan, query.get("setup"));
  const measuring = useSignal<number[][] | null>(null);
  const [withViews, setWithViews] = useState(true);
  const areas = useMemo(() => areasBy(model), [model]);
  const lies = useMemo(() => {
    const pose = setup === null ? null : tableFromPart(model.plan, setup);
    return pose && matrixOf(pose);
  }, [model, setup]);
  const chosen = useComputed(() => state.views.value.find((view) => view.id === state.chosen.value) ?? null);

  useEffect(() => {
    if (!stage) { scene.current = null; return; }
    if (scene.current?.stage === stage) { scene.current.lay(lies); return; }
    void stage.drawn.then(() => state.tracer.begin());
    scene.current = new PlanScene(stage, model, lies);
    window.vantage.plan = { model, scene: scene.current, state };
  }, [stage, setup]);
  useEffect(() => {
    const face = query.get("spot");
    if (face === null || !(Number(face) < model.mesh.faces)) void state.askAt(null);
    else if (String(state.spot.peek()?.hit.face) !== face) void state.askAt(hitOf(model, Number(face)));
  }, [visits.value]);
  useEffect(() => {
    if ((mode === "count" || mode === "incidence" || isEdited(state.views.peek())) && !state.scores.peek()) void scoreBoth(state);
  }, [mode]);
  useEffect(() => {
    if (!scene.current) return;
    scene.current.marked = state.marked.value;
    scene.current.paint(painter(model, mode, state.scores.value, threshold));
  }, [stage, mode, state.scores.value, level, state.marked.value]);
  useEffect(() => {
    const views = withViews ? state.views.value.filter((view) => setup === null || view.setup === setup) : [];
    scene.current?.showViews(views, state.chosen.value, (view) => labelOf(model, view), state.chooseView);
  }, [stage, state.views.value, state.chosen.value, withViews, setup]);
  useEffect(() => stage?.hover(state.hovered.value), [stage, state.hovered.value, state.views.value, state.chosen.value]);
  useEffect(() => scene.current?.showFrustum(chosen.value), [stage, chosen.value, setup]);
  useEffect(() => { scene.current?.cut(section.axis, section.share); }, [stage, section.axis, section.share, setup]);
  const measured = measuring.value ?? [];
  const distance = measured.length === 2 ? Math.hypot(...measured[0]!.map((value, i) => value - measured[1]![i]!)) : 0;
  useEffect(() => scene.current?.showPins(state.spot.value?.hit ?? null, measured, text.plan.distance(length(distance)), state.box.value),
    [stage, state.spot.value, measuring.value, state.box.value]);

  const lay = (value: string): void => {
    // A view of another setup is not one of the part as it lies now.
    if (value !== "file" && chosen.value && String(chosen.value.setup) !== value) state.chooseView(null);
    setQuery({ setup: value === "0" ? undefined : value });
  };
  const picked = (pick: PointerPick): Promise<Hit | null> => {
    const { origin, direction } = scene.current?.inPart(pick) ?? pick;
    return state.tracer.pick(origin, direction, scene.current?.plane() ?? null);
  };
  /** Turns the camera to a spot that it does not see. */
  const reveal = async (hit: Hit | null): Promise<void> => {
    if (!hit) return;
    await scene.current?.reveal(hit, async (from) => {
      const way = hit.point.map((value, i) => value - from[i]!);
      const met = await state.tracer.pick(from, way, scene.current?.plane() ?? null);
      return met !== null && Math.hypot(...met.point.map((value, i) => value - hit.point[i]!)) < 1e-3 * Math.hypot(...way);
    }, () => state.spot.peek()?.hit === hit);
  };
  const clicked = async (pick: PointerPick): Promise<void> => {
    const hit = await picked(pick);
    if (measuring.peek()) {
      if (hit) measuring.value = measuring.peek()!.length === 2 ? [hit.point] : [...measuring.peek()!, hit.point];
      return;
    }
    if (panel === "regions") { if (hit) await mark(state, hit, pick.isExtended); return; }
    const from = scene.current?.inPart(pick).origin ?? pick.origin;
    const away = hit ? Math.hypot(...hit.point.map((value, i) => value - from[i]!)) : Infinity;
    const view = scene.current?.viewAt(pick, away) ?? null;
    if (view !== null) state.chooseView(view);
    else await state.askAt(hit);
  };
  const brushed = async (pick: PointerPick): Promise<void> => {
    const hit = await picked(pick);
    if (hit) await mark(state, hit, pick.isExtended);
  };
  if (stage) {
    stage.onClick = (pick) => void clicked(pick);
    stage.onHover = (pick) => { state.hovered.value = pick && (scene.current?.viewAt(pick, Infinity) ?? null); };
    stage.onBrush = panel === "regions" && state.tool.value === "brush" ? (pick) => void brushed(pick) : null;
  }

  return (
    <div class="plan">
      <div class="left">
        <View3d label={text.plan.part} name="plan" onStage={setStage} box={() => scene.current?.wholeBox() ?? null}
          tools={<>
            <Button aria-pressed={measuring.value !== null} onClick={() => { measuring.value = measuring.value ? null : []; }}>{text.plan.measure}</Button>
            <Button aria-pressed={withViews} onClick={() => setWithViews(!withViews)}>{text.plan.allViews}</Button>
          </>}>
          <div class="overlay"><div class="overlaybar">
            <Select label={text.plan.colour} value={mode} onChange={(value) => setQuery({ colour: value === "grade" ? undefined : value, level: undefined })} options={Object.entries(text.plan.colours)} />
            <ThresholdSlider mode={mode} at={threshold} scores={state.scores.value} onLevel={(value) => setQuery({ level: String(value) })} />
            {model.plan.cell && <Select label={text.plan.lying} name="setup" value={setup === null ? "file" : String(setup)} onChange={lay} options={standings(model)} />}
            <SectionTool section={section} box={lyingBox(model, lies)} onSection={(axis, share) => setQuery({ section: axis === "off" ? undefined : `${axis}${share}` })} />
            {measuring.value && <span class="soft">{measured.length === 2 ? text.plan.distance(length(distance)) : text.plan.measureHint}</span>}
            {state.computing.value !== null && <span role="status">{text.plan.computing(percent(state.computing.value, 0))}</span>}
          </div>
          <Legend state={state} mode={mode} areas={areas} /></div>
        </View3d>
      </div>
      <aside class="side">
        <Tabs label={text.plan.panels.summary!} names={text.plan.panels} chosen={panel} onChoose={(name) => setQuery({ panel: name === "summary" ? undefined : name })} />
        {state.spot.value && panel !== "regions" && <SpotPanel state={state} spot={state.spot.value} mode={mode} />}
        {panel === "summary" && <SummaryPanel state={state} />}
        {panel === "views" && <ViewsPanel state={state} />}
        {panel === "misses" && <MissesPanel state={state} mode={mode} onSpot={(spot, reason) => void state.showSpot(spot, reason).then(reveal)} />}
        {panel === "regions" && <RegionsPanel state={state} />}
        {panel === "charts" && <ChartsPanel state={state} />}
      </aside>
    </div>
  );
}

/** The part as it lies in each setup, and as in its file. */
const standings = ({ plan: { setups = [] } }: Model): [string, string][] => [
  ...(setups.length > 1 ? setups.map((_, i): [string, string] => [String(i), text.cell.setup(i + 1)]) : [["0", text.plan.onPlate] as [string, string]]),
  ["file", text.plan.asFile],
];

const labelOf = ({ plan }: Model, { id }: EditedView): string => plan.viewpoints.find((view) => view.id === id)?.label ?? text.plan.added(id);

/** Scores of the views as planned, against which a change is held, and as changed. */
async function scoreBoth(state: Plan3d): Promise<void> {
  const { plan } = state.model;
  if (isEdited(state.views.peek())) await state.score(plannedViews(plan));
  await state.score();
}

function ThresholdSlider({ mode, at, scores, onLevel }: { mode: Colouring; at: Threshold; scores: Scores | null; onLevel: (level: number) => void }) {
  if (mode === "grade") return <Slider label={text.plan.threshold} min={1} max={4} value={at.grade} show={"ABCD"[at.grade - 1]!} onInput={onLevel} />;
  if (mode === "count") {
    const most = scores ? Math.max(2, scores.counts.reduce((max, n) => Math.max(max, n), 1)) : 10;
    return <Slider label={text.plan.threshold} min={1} max={most} value={at.count} show={text.plan.atLeast(at.count)} onInput={onLevel} />;
  }
  if (mode === "incidence") return <Slider label={text.plan.threshold} min={5} max={90} value={at.incidence} show={text.plan.upTo(at.incidence)} onInput={onLevel} />;
  return null;
}

interface Section { axis: SectionAxis; share: number }

/** Section plane of an address: `x0.25` is a quarter along x. */
function sectionOf(given: string | null): Section {
  const [, axis = "off", share = "0.5"] = /^([xyz])(0(?:\.\d+)?|1)$/.exec(given ?? "") ?? [];
  return { axis: axis as SectionAxis, share: Number(share) };
}

function SectionTool({ section: { axis, share }, box, onSection }: { section: Section; box: Box3; onSection: (axis: SectionAxis, share: number) => void }) {
  return (
    <>
      <Select label={text.plan.section} value={axis} onChange={(value) => onSection(value as SectionAxis, share)}
        options={[["off", text.plan.sectionOff], ["x", "X"], ["y", "Y"], ["z", "Z"]]} />
      {axis !== "off" && <Slider label={text.plan.position} min={0} max={1} step={0.005} value={share} show={length(sectionAt(box, axis, share))} onInput={(value) => onSection(axis, value)} />}
    </>
  );
}

/** Marks faces of a region under a click or a stroke of the brush; with shift they are unmarked. */
async function mark(state: Plan3d, hit: Hit, isErased: boolean): Promise<void> {
  const { tracer, tool } = state;
  if (tool.peek() === "box") return drawBox(state, hit);
  const isFlood = tool.peek() === "faces";
  // The middle of a large face may lie beyond the brush that touches it.
  const faces = isFlood ? await tracer.flood(hit.face, state.sharp.peek()) : [hit.face, ...await tracer.near(hit.point, state.radius.peek(), hit.normal)];
  const next = new Set(state.marked.peek());
  faces.forEach((face) => { if (isErased) next.delete(face); else next.add(face); });
  state.marked.value = next;
}

/** The first click sets a corner, the second the other, a third begins anew. */
async function drawBox(state: Plan3d, { point }: Hit): Promise<void> {
  const old = state.box.peek();
  const isPoint = old && old.min.every((value, i) => value === old.max[i]);
  if (!old || !isPoint) { state.box.value = { min: [...point], max: [...point] }; return; }
  // A box of no depth would hold no surface.
  const room = state.radius.peek();
  await setBox(state, old.min.map((value, i) => Math.min(value, point[i]!) - room), old.max.map((value, i) => Math.max(value, point[i]!) + room));
}

export async function setBox(state: Plan3d, min: number[], max: number[]): Promise<void> {
  state.box.value = { min, max };
  state.marked.value = new Set(await state.tracer.box(min, max));
}

/** Moves a view by hand; the coverage follows at once. */
export function moveView(state: Plan3d, id: number, change: Partial<EditedView["move"]>): void {
  state.views.value = state.views.peek().map((view) => {
    if (view.id !== id) return view;
    const move = { ...view.move, ...change };
    const isStill = Object.values(move).every((value) => value === 0);
    return { ...view, move, pose: isStill ? view.origin : moved(view.origin, state.model.optics.best, move) };
  });
}

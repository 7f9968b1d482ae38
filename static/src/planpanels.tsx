// Panels beside the plan in 3D: summary, views, misses, regions, charts, and the spot that was asked for.
import { useSignal, type Signal } from "@preact/signals";
import { useEffect, useMemo, useRef } from "preact/hooks";
import type { MissedListing, Spot } from "./api";
import { isGrade } from "./bytes";
import { Chart } from "./chart";
import { RegionTable, Remedy, Sentences, UnitNote, Warnings } from "./job";
import { causeColour, css, GRADES, viewColour } from "./palette";
import { moveView, setBox, type Plan3d, type RegionTool, type SpotState } from "./plan";
import { gradeOf, isEdited, remedySet, STILL, type EditedView } from "./planmodel";
import { legendOf, type Colouring } from "./planscene";
import { area, degrees, fromShown, length, lengthIn, lengthUnit, percent, point, seconds, unit } from "./settings";
import { text } from "./text";
import { Button, Select, Slider, Swatch } from "./widgets";

const words = text.plan;
const causeName = (cause: string): string => text.causes[cause] ?? cause;
/** Name of the area that a plan is not for: of further views, also what earlier scans measured. */
const notAsked = ({ model }: Plan3d): string => (model.job.summary?.of_open ? words.notOpen : words.notAsked);
/** Cause in words, and in its colour where causes colour the part: in other modes the same colours are grades. */
const Cause = ({ cause, mode }: { cause: string; mode: Colouring }) => <>{mode === "cause" && <><Swatch colour={css(causeColour(cause))} /> </>}{causeName(cause)}</>;

export function Legend({ state, mode, areas }: { state: Plan3d; mode: Colouring; areas: Map<string, number> }) {
  const scores = state.scores.value;
  const rows = useMemo(() => legendOf(state.model, mode, scores, areas, {
    causes: text.causes, grades: words.gradeNames, missed: words.notMeasured, measured: words.measured, notAsked: notAsked(state), views: text.jobs.views,
  }), [mode, scores, areas]);
  const total = [...areas.values()].reduce((sum, value) => sum + value, 0);
  return (
    <div class="legend" tabIndex={0} role="group" aria-label={words.legend}>
      <table aria-label={words.legend}>
        <tbody>
          {rows.map((row) => (
            <tr key={row.key} data-key={row.key}><th scope="row"><Swatch colour={css(row.colour)} /> {row.name}</th>
              <td class="number">{area(row.area)}</td><td class="number">{percent(row.area / total)}</td></tr>
          ))}
        </tbody>
      </table>
      <p class="soft">{words.legendOf}</p>
      {(mode === "count" || mode === "incidence") && <p class="soft">{words.estimate}</p>}
    </div>
  );
}

export function SummaryPanel({ state }: { state: Plan3d }) {
  const { job } = state.model;
  return (
    <div>
      <Sentences job={job} />
      <h2>{words.denominators}</h2>
      <dl class="shares">
        {job.summary?.headline?.map(({ name, share, independent, meaning }) => (
          <div key={name}>
            <dt><strong>{percent(share, 2)}</strong><meter min={0} max={1} value={share} aria-label={name} /></dt>
            <dd><b>{name}</b>{independent && words.independent}<br />{meaning}</dd>
          </div>
        ))}
      </dl>
      <p class="soft">{words.independence}</p>
      <p class="soft">{words.spotHint}</p>
      <Warnings of={job.warnings} />
    </div>
  );
}

const CAUSE_ORDER = Object.keys(text.causes);

export function SpotPanel({ state, spot, mode }: { state: Plan3d; spot: SpotState; mode: Colouring }) {
  const views = state.views.value;
  const rows = spot.judgements.map((judgement, i) => ({ judgement, view: views[i] })).filter((row) => row.view?.isUsed);
  const seen = rows.filter((row) => !row.judgement.cause).sort((a, b) => b.judgement.quality - a.judgement.quality);
  const groups = new Map<string, number[]>();
  rows.filter((row) => row.judgement.cause).forEach(({ judgement, view }) => {
    groups.set(judgement.cause!, [...(groups.get(judgement.cause!) ?? []), view!.id]);
  });
  const panel = useRef<HTMLElement>(null);
  // The answer to a click is shown, wherever the list beside was scrolled to.
  useEffect(() => panel.current?.scrollIntoView({ block: "nearest" }), [spot]);
  const isMeasured = isGrade(spot.meaning);
  // Views that were changed by hand are not those that the plan judged.
  const isDisputed = isMeasured !== (seen.length > 0) && spot.meaning !== "not_asked" && !isEdited(views);
  const verdict = isMeasured ? words.gradeNames[spot.meaning]! : spot.meaning === "not_asked" ? notAsked(state) : causeName(spot.meaning);
  return (
    <section class="spot" aria-label={words.spot} ref={panel}>
      <div class="head"><h2>{seen.length ? words.seenBy(seen.length) : words.unseen}</h2><Button onClick={() => state.askAt(null)} aria-label={text.close}>×</Button></div>
      <p>{words.planCause}: <strong data-spot={spot.meaning}>{verdict}</strong> <span class="soft">({point(spot.hit.point)}) {lengthUnit()} {words.fileAxes}</span></p>
      {isDisputed && <p id="disputed">{isMeasured ? words.planSeesMore : words.planSeesLess}</p>}
      {seen.length > 0 && (
        <table>
          <thead><tr><th scope="col">{words.panels.views}</th><th scope="col">{words.colours.grade}</th><th scope="col">{words.incidence}</th><th scope="col">{words.depth}</th></tr></thead>
          <tbody>{seen.map(({ judgement, view }) => (
            <tr key={view!.id}><td><button type="button" class="link" onClick={() => state.chooseView(view!.id)}>{words.view(view!.id)}</button></td>
              <td><Swatch colour={css(GRADES[gradeOf(judgement.quality)]!)} /> {gradeOf(judgement.quality)}</td>
              <td class="number">{degrees(judgement.incidenceDeg)}</td><td class="number">{length(judgement.depthMm)}</td></tr>
          ))}</tbody>
        </table>
      )}
      {groups.size > 0 && (
        <details open={seen.length === 0}>
          <summary>{words.whyNot}</summary>
          <ul class="causes">{[...groups].sort(([a], [b]) => CAUSE_ORDER.indexOf(b) - CAUSE_ORDER.indexOf(a)).map(([cause, ids]) => (
            <li key={cause}><Cause cause={cause} mode={mode} />: {ids.map((id) => (
              <button key={id} type="button" class="link" onClick={() => state.chooseView(id)}>{id}</button>
            ))}</li>
          ))}</ul>
        </details>
      )}
      {spot.spot && <SpotRemedy state={state} spot={spot.spot} />}
      <p class="actions"><Button onClick={state.addView}>{words.addView}</Button></p>
    </section>
  );
}

function SpotRemedy({ state, spot }: { state: Plan3d; spot: Spot }) {
  const remedy = spot.remedy;
  return (
    <div class="remedy">
      <strong>{words.remedy}</strong> <span class="soft">{area(spot.area_mm2)}</span>
      <p>{remedy ? remedy.text : words.noRemedy}</p>
      <UnitNote of={[remedy?.text]} />
      {remedy && <Remedy job={state.model.job} label={text.job.apply} set={remedySet(state.model, spot, remedy)} />}
    </div>
  );
}

function MoveForm({ state, view }: { state: Plan3d; view: EditedView }) {
  const timer = useRef<ReturnType<typeof setTimeout> | undefined>(undefined);
  const set = (change: Partial<EditedView["move"]>): void => {
    moveView(state, view.id, change);
    clearTimeout(timer.current);
    timer.current = setTimeout(() => void state.score(), 120);
  };
  const { tiltX, tiltY, roll, standoff } = view.move;
  return (
    <div class="move">
      <h2>{words.moveView}</h2>
      <Slider label={`${words.tilt} X`} min={-45} max={45} value={tiltX} show={`${tiltX}°`} onInput={(value) => set({ tiltX: value })} />
      <Slider label={`${words.tilt} Y`} min={-45} max={45} value={tiltY} show={`${tiltY}°`} onInput={(value) => set({ tiltY: value })} />
      <Slider label={words.roll} min={-180} max={180} value={roll} show={`${roll}°`} onInput={(value) => set({ roll: value })} />
      <Slider label={words.standoff} min={-80} max={80} value={standoff} show={length(standoff)} onInput={(value) => set({ standoff: value })} />
    </div>
  );
}

function Edited({ state }: { state: Plan3d }) {
  const views = state.views.value;
  if (!isEdited(views)) return null;
  const [before, now] = [state.plannedScores.value, state.scores.value];
  const undo = (): void => {
    state.views.value = views.filter((view) => !view.isAdded).map((view) => ({ ...view, pose: view.origin, isUsed: view.wasUsed, move: STILL }));
    void state.score();
  };
  const prove = (): Promise<void> => state.apply({
    "candidates.poses": views.filter((view) => view.isUsed).map((view) => view.pose), "candidates.strategies": [],
    "selection.target": 1, "selection.min_growth": 0,
  });
  return (
    <section class="edited" aria-label={words.edited}>
      <h2>{words.edited}</h2>
      <p>{words.estimateNow}: {before && <span>{percent(before.measured / before.total, 2)} {words.before} → </span>}
        <strong id="edited-share">{now ? percent(now.measured / now.total, 2) : "…"}</strong> {words.after}</p>
      <p class="soft">{words.estimate}</p>
      <p class="actions"><Button kind="primary" onClick={prove}>{words.planEdited}</Button><Button onClick={undo}>{words.undo}</Button></p>
    </section>
  );
}

export function ViewsPanel({ state }: { state: Plan3d }) {
  const { plan } = state.model;
  const chosen = state.views.value.find((view) => view.id === state.chosen.value);
  const hasSetups = (plan.setups?.length ?? 0) > 1;
  const order = new Map(plan.sequence.map((id, at) => [id, at + 1]));
  // The share as planned, against which a change is held, is computed first.
  const use = async (id: number, isUsed: boolean): Promise<void> => {
    if (!state.plannedScores.peek()) await state.score();
    state.views.value = state.views.peek().map((view) => (view.id === id ? { ...view, isUsed } : view));
    await state.score();
  };
  return (
    <div>
      <Edited state={state} />
      <p class="soft">{words.viewsHint}</p>
      {chosen && <MoveForm state={state} view={chosen} />}
      <ul class="views">
        {state.views.value.map((view) => {
          const planned = plan.viewpoints.find((other) => other.id === view.id);
          const station = planned?.station;
          return (
            <li key={view.id} class={view.id === state.chosen.value ? "chosen" : view.id === state.hovered.value ? "hovered" : ""}
              onPointerEnter={() => { state.hovered.value = view.id; }} onPointerLeave={() => { state.hovered.value = null; }}
              onFocusIn={() => { state.hovered.value = view.id; }} onFocusOut={() => { state.hovered.value = null; }}>
              <input type="checkbox" aria-label={words.use(view.id)} checked={view.isUsed} onChange={(event) => void use(view.id, event.currentTarget.checked)} />
              <button type="button" class="row" aria-pressed={view.id === state.chosen.value} onClick={() => state.chooseView(view.id === state.chosen.value ? null : view.id)}>
                <strong><Swatch colour={css(viewColour(view, view.id === state.chosen.value))} /> {words.view(view.id)}</strong>
                <span>{planned ? planned.label : words.added(view.id)}</span>
                <span class="number">{planned && words.adds(percent(planned.gain_of_asked))}</span>
                <span class="soft">{planned?.rejected ? words.rejected : [hasSetups && text.cell.setup(view.setup + 1), order.has(view.id) && `#${order.get(view.id)}`,
                  station?.clearance_mm !== undefined && station.clearance_mm !== null && words.clearance(length(station.clearance_mm))].filter(Boolean).join(" · ")}</span>
              </button>
            </li>
          );
        })}
      </ul>
    </div>
  );
}

const MAX_SPOTS = 60;
/** Spots that the report numbers for their size (`src/report/html/spots.rs`); those with a remedy have a number too. */
const NUMBERED = 20;

interface MissedSpot { reason: string; spot: Spot; number: number | null }

/** All missed spots, largest first, with their numbers in the report. */
function numbered({ missed }: MissedListing): MissedSpot[] {
  const all = missed.flatMap(({ reason, listing }) => listing.map((spot) => ({ reason, spot }))).sort((a, b) => b.spot.area_mm2 - a.spot.area_mm2);
  let last = 0;
  return all.map((one, rank) => ({ ...one, number: rank < NUMBERED || one.spot.remedy ? (last += 1) : null }));
}

export function MissesPanel({ state, mode, onSpot }: { state: Plan3d; mode: Colouring; onSpot: (spot: Spot, reason: string) => void }) {
  const { job, missed } = state.model;
  const fixes = (job.summary?.missed ?? []).filter((group) => Object.keys(group.set).length > 0);
  const spots = useMemo(() => numbered(missed).slice(0, MAX_SPOTS), [missed]);
  const all = missed.missed.reduce((sum, { listing }) => sum + listing.length, 0);
  if (all === 0) return <p class="good">{words.noMisses}</p>;
  return (
    <div>
      {fixes.length > 0 && <h2>{words.fixes}</h2>}
      <ul class="fixes">
        {fixes.map((group) => (
          <li key={group.text}>{words.missCount(group.spots)}, {percent(group.of_asked, 2)}: <Cause cause={group.reason} mode={mode} />.
            {" "}{group.partial_text ? `${group.partial_text}: ${group.fix_text}` : `${group.fix_text} (${area(group.recovers_mm2)})`} <Remedy job={job} label={text.job.apply} set={group.set} /></li>
        ))}
      </ul>
      <h2>{words.misses}{all > spots.length && ` (${spots.length} ${text.runs.of} ${all})`}</h2>
      <p class="soft">{words.numbered}</p>
      <UnitNote of={spots.map(({ spot }) => spot.remedy?.text)} />
      <ul class="spots">
        {spots.map(({ reason, spot, number }, i) => (
          <li key={i}><button type="button" class="row" onClick={() => onSpot(spot, reason)}>
            <span>{number !== null && <strong>{number}{" "}</strong>}<Cause cause={reason} mode={mode} /></span><span class="number">{area(spot.area_mm2)}</span>
            <span class="soft">{spot.remedy?.text ?? ""}</span></button></li>
        ))}
      </ul>
    </div>
  );
}

interface RegionDraft { use: "exclude" | "interest"; name: string; target: number }

async function planWithRegion(state: Plan3d, { use, name, target }: RegionDraft): Promise<void> {
  const { job, mesh } = state.model;
  const box = state.tool.peek() === "box" ? state.box.peek() : null;
  const region = box ? { kind: "box", min_mm: box.min, max_mm: box.max }
    : { kind: "faces", faces: [...state.marked.peek()].flatMap((face) => mesh.sourceFaces(face)).sort((a, b) => a - b) };
  const regions = (job.params as { regions?: { exclude?: unknown[]; interest?: unknown[] } }).regions ?? {};
  await state.apply(use === "exclude" ? { "regions.exclude": [...(regions.exclude ?? []), region] }
    : { "regions.interest": [...(regions.interest ?? []), { region, ...(name && { name }), target }] });
}

function BoxFields({ state, box }: { state: Plan3d; box: { min: number[]; max: number[] } }) {
  const field = (end: "min" | "max", i: number) => (
    <input type="number" step="any" aria-label={`${end} ${"XYZ"[i]}`} value={lengthIn(box[end][i]!).toFixed(unit.value === "mm" ? 2 : 4)} onChange={(event) => {
      const next = { min: [...box.min], max: [...box.max] };
      next[end][i] = fromShown(event.currentTarget.valueAsNumber);
      void setBox(state, next.min, next.max);
    }} />
  );
  return <p class="numbers">{[0, 1, 2].map((i) => field("min", i))}<br />{[0, 1, 2].map((i) => field("max", i))} {lengthUnit()} {words.fileAxes}</p>;
}

export function RegionsPanel({ state }: { state: Plan3d }) {
  const draft = useSignal<RegionDraft>({ use: "exclude", name: "", target: 0.95 });
  const { mesh, job } = state.model;
  const marked = state.marked.value;
  const markedArea = [...marked].reduce((sum, face) => sum + mesh.areas[face]!, 0);
  const clear = (): void => { state.marked.value = new Set(); state.box.value = null; };
  // What is marked is not left behind when another panel is read.
  useEffect(() => clear, []);
  return (
    <div class="drawing">
      <p class="soft">{words.regionHint}</p>
      <Select label={words.regionKind} value={state.tool.value} onChange={(tool) => { clear(); state.tool.value = tool as RegionTool; }} options={Object.entries(words.kinds)} />
      {state.tool.value === "faces" ? <Slider label={words.sharp} min={1} max={90} value={state.sharp.value} show={`${state.sharp.value}°`} onInput={(value) => { state.sharp.value = value; }} />
        : <Slider label={state.tool.value === "box" ? words.margin : words.radius} min={0.5} max={40} step={0.5} value={state.radius.value} show={length(state.radius.value)} onInput={(value) => { state.radius.value = value; }} />}
      {state.tool.value === "box" && state.box.value && <BoxFields state={state} box={state.box.value} />}
      <p><strong id="marked-area">{words.drawn(area(markedArea))}</strong> <Button onClick={clear}>{words.clear}</Button></p>
      <RegionUse draft={draft} />
      <p class="actions"><Button kind="primary" disabled={marked.size === 0} onClick={() => planWithRegion(state, draft.value)}>{words.regionPlan}</Button></p>
      {Boolean(job.regions?.length) && <><h2>{words.regionList}</h2><div class="scroll" tabIndex={0} role="group" aria-label={text.results.regions}><RegionTable regions={job.regions!} /></div></>}
    </div>
  );
}

function RegionUse({ draft }: { draft: Signal<RegionDraft> }) {
  const set = (change: Partial<RegionDraft>): void => { draft.value = { ...draft.value, ...change }; };
  return (
    <>
      <Select label={words.regionUse} value={draft.value.use} onChange={(use) => set({ use: use as RegionDraft["use"] })} options={Object.entries(words.uses)} />
      {draft.value.use === "interest" && (
        <>
          <label><span>{words.regionName}</span><input type="text" placeholder={text.create.optional} value={draft.value.name} onInput={(event) => set({ name: event.currentTarget.value })} /></label>
          <Slider label={words.target} min={0} max={1} step={0.01} value={draft.value.target} show={percent(draft.value.target, 0)} onInput={(target) => set({ target })} />
        </>
      )}
    </>
  );
}

function Bars({ title, rows }: { title: string; rows: { name: string; value: number; show: string; colour?: string }[] }) {
  const most = Math.max(...rows.map((row) => row.value), 1e-9);
  return (
    <figure class="bars">
      <figcaption>{title}</figcaption>
      <table><tbody>{rows.map((row) => (
        <tr key={row.name}><th scope="row">{row.name}</th><td class="share"><span style={{ width: `${(100 * row.value) / most}%`, ...(row.colour && { background: row.colour }) }} /></td>
          <td class="number">{row.show}</td></tr>
      ))}</tbody></table>
    </figure>
  );
}

export function ChartsPanel({ state }: { state: Plan3d }) {
  const { plan, job } = state.model;
  const { curve } = plan.coverage;
  const upper = plan.bound?.of_asked_upper;
  const x = useMemo(() => [0, ...curve.map((_, i) => i + 1)], [curve]);
  const lines = useMemo(() => [
    { label: words.measured, values: [0, ...curve] },
    ...(typeof upper === "number" ? [{ label: words.bound, values: x.map(() => upper), isDashed: true, isFaint: true }] : []),
  ], [curve]);
  const parts = job.summary?.cycle_parts;
  return (
    <div>
      <Chart title={[words.curve, plan.bound && plan.bound.views_lower > 0 && words.lower(plan.bound.views_lower), typeof upper === "number" && words.upper(percent(upper, 2))].filter(Boolean).join("; ")} x={x} lines={lines} xLabel={words.views} yLabel={job.summary?.of_open ? text.jobs.open : text.jobs.asked} percent points yRange={[0, 1]}
        onPick={(at) => { const view = plan.viewpoints[Math.max(0, Math.round(at) - 1)]; if (view) state.chooseView(view.id); }} />
      <Bars title={job.summary?.of_open ? words.gradesOpen : words.grades} rows={Object.entries(plan.coverage.grades).map(([grade, share]) => ({ name: words.gradeNames[grade] ?? grade, value: share, show: percent(share), colour: css(GRADES[grade]!) }))} />
      {parts && <Bars title={words.cycle} rows={[
        { name: words.moving, value: parts.moving_secs, show: seconds(parts.moving_secs) }, { name: words.scanning, value: parts.scanning_secs, show: seconds(parts.scanning_secs) },
        { name: words.settling, value: parts.settling_secs, show: seconds(parts.settling_secs) }]} />}
      <Bars title={words.time} rows={Object.entries(job.timings).sort(([, a], [, b]) => b - a).map(([stage, secs]) => ({ name: text.stages[stage] ?? stage, value: secs, show: `${secs.toFixed(2)} s` }))} />
    </div>
  );
}

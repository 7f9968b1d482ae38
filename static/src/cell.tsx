// The cell while the program runs: playback with time line, steps, speed, joint plots with their limits.
import { useSignal } from "@preact/signals";
import { useEffect, useMemo, useRef, useState } from "preact/hooks";
import { ask, type Job, type Plan, type Pose, type Program } from "./api";
import { CellScene, cellModelOf, type CellModel } from "./cellscene";
import { FARTHEST_MM, type Clearance } from "./collide";
import { Chart } from "./chart";
import { ClearanceTracer, coverageBytes, fixtureOf, preview, type Preview } from "./mesh";
import { LINES } from "./palette";
import { ReachPanel } from "./reachpanel";
import { fine, length, lengthIn, lengthUnit, percent, seconds, unit } from "./settings";
import { STANDARD_VIEWS, type Stage } from "./stage";
import { text } from "./text";
import { configurationAt, sampled, spanAt, timelineOf, type Timeline } from "./timeline";
import { Button, Pending, Select, useLoaded } from "./widgets";
import { View3d } from "./view3d";

const words = text.cell;

interface Loaded { model: CellModel; plan: Plan; mesh: Preview; fixture: Preview | null; bytes: Uint8Array; programs: Program[] }

/** Programs of all setups that have one. */
export async function programsOf(job: Job): Promise<Program[]> {
  const names = ["program", "program-2", "program-3", "program-4"].filter((name) => job.results.some((file) => file.name === `${name}.json`));
  return Promise.all(names.map((name) => ask<Program>(`/jobs/${job.id}/${name}`)));
}

async function load(job: Job): Promise<Loaded> {
  const [model, plan, mesh, bytes, programs] = await Promise.all([
    cellModelOf(job), ask<Plan>(`/jobs/${job.id}/plan`), preview(job.mesh_id), coverageBytes(job.id), programsOf(job),
  ]);
  return { model, plan, mesh, fixture: await fixtureOf(plan), bytes, programs };
}

interface Props { job: Job; query: URLSearchParams; setQuery: (changes: Record<string, string | undefined>) => void }

export function CellView(props: Props) {
  const hasCell = props.job.results.some((file) => file.name === "program.json");
  const { value, error } = useLoaded(() => (hasCell ? load(props.job) : Promise.resolve(null)), [hasCell]);
  if (!hasCell) return <p class="empty">{words.noCell}</p>;
  if (error || !value) return <Pending error={error} />;
  return <Player {...props} loaded={value} />;
}

const SPEEDS = [0.25, 0.5, 1, 2, 5, 10];

/** Clock of the playback. */
function usePlayback(timeline: Timeline, start: number) {
  const time = useSignal(start);
  const playing = useSignal(false);
  const speed = useSignal(1);
  useEffect(() => {
    if (!playing.value) return undefined;
    let last = performance.now();
    let frame = requestAnimationFrame(function tick(now) {
      time.value = Math.min(timeline.total, time.peek() + ((now - last) / 1000) * speed.peek());
      last = now;
      if (time.peek() >= timeline.total) playing.value = false;
      else frame = requestAnimationFrame(tick);
    });
    return () => cancelAnimationFrame(frame);
  }, [playing.value, timeline]);
  return { time, playing, speed };
}

/** Points in time for which the distance is drawn: ten a second, 600 at most. */
const clearancePoints = (total: number): number => Math.max(50, Math.min(600, Math.round(10 * total)));

interface Clearances { curve: { x: number[]; mm: number[]; least: number } | null; now: Clearance | null; share: number; minMm: number; failure: string }

/** Distance of the nearest bodies: along the whole program once, and at the present configuration as fast as it can be told. */
function useClearances(loaded: Loaded, timeline: Timeline, tableFromPart: Pose, configuration: number[]): Clearances {
  const minMm = loaded.plan.params.motion.clearance_mm;
  const state = useSignal<Clearances>({ curve: null, now: null, share: 0, minMm, failure: "" });
  const ask = useRef<((configuration: number[]) => void) | null>(null);
  const wanted = useRef(configuration);
  wanted.current = configuration;
  useEffect(() => {
    const { cell, robot, table, scanner, meshes } = loaded.model;
    const tracer = new ClearanceTracer({ cell, robot, table, scanner, clearanceMm: minMm, part: loaded.mesh.positions, fixture: loaded.fixture?.positions ?? null, tableFromPart,
      meshes: Object.fromEntries(Object.entries(meshes).map(([id, mesh]) => [id, mesh.positions])) });
    state.value = { curve: null, now: null, share: 0, minMm, failure: "" };
    let isBusy = false;
    ask.current = (asked) => {
      if (isBusy) return;
      isBusy = true;
      void tracer.at([asked]).finally(() => { isBusy = false; }).then(([now]) => {
        state.value = { ...state.value, now: now ?? null };
        // The clock went on meanwhile.
        if (wanted.current.join() !== asked.join()) ask.current?.(wanted.current);
      }, () => {});
    };
    ask.current(wanted.current);
    const count = clearancePoints(timeline.total);
    const x = Array.from({ length: count + 1 }, (_, i) => (timeline.total * i) / count);
    void tracer.at(x.map((at) => configurationAt(timeline, at)), (share) => { state.value = { ...state.value, share }; }).then((found) => {
      const mm = found.map((clearance) => clearance?.mm ?? FARTHEST_MM);
      state.value = { ...state.value, share: 1, curve: { x, mm, least: mm.indexOf(Math.min(...mm)) } };
    }, (error: Error) => { state.value = { ...state.value, failure: error.message }; });
    window.vantage.clearanceAt = (configurations: number[][]) => tracer.at(configurations);
    return () => { ask.current = null; tracer.close(); };
  }, [timeline]);
  useEffect(() => ask.current?.(configuration), [configuration.join()]);
  return state.value;
}

function Player({ query, setQuery, loaded }: Props & { loaded: Loaded }) {
  const named = Number(query.get("setup"));
  const setup = loaded.programs[named] ? named : 0;
  const program = loaded.programs[setup]!;
  const timeline = useMemo(() => timelineOf(program), [program]);
  const { time, playing, speed } = usePlayback(timeline, Math.min(timeline.total, Number(query.get("t")) || 0));
  const scene = useRef<CellScene | null>(null);
  const [stage, setStage] = useState<Stage | null>(null);
  const beams = useSignal(true);
  const now = time.value;
  const configuration = configurationAt(timeline, now);
  const span = spanAt(timeline, now);

  const tableFromPart = loaded.plan.setups?.[setup]?.table_from_part ?? loaded.plan.cell!.table_from_part;
  const clearances = useClearances(loaded, timeline, tableFromPart, configuration);
  useEffect(() => {
    if (!stage) return undefined;
    const made = new CellScene(stage, loaded.model, loaded.plan);
    scene.current = made;
    made.showPart(loaded.mesh, loaded.bytes, loaded.fixture, tableFromPart);
    stage.look(made.box(), STANDARD_VIEWS.iso!);
    window.vantage.cell = { scene: made, timeline, loaded, configurationAt: (at: number) => configurationAt(timeline, at), seek: (at: number) => { time.value = at; } };
    return () => { made.dispose(); scene.current = null; };
  }, [stage, setup]);
  useEffect(() => scene.current?.pose(configuration), [stage, now, setup]);
  useEffect(() => scene.current?.showBeams(beams.value), [stage, setup, beams.value]);
  useEffect(() => scene.current?.showGap(clearances.now, (clearances.now?.mm ?? FARTHEST_MM) < 2 * clearances.minMm), [stage, setup, clearances.now]);
  // The address follows where playback rests; while it runs that would be sixty addresses a second.
  useEffect(() => { if (!playing.value) setQuery({ t: now > 0 ? now.toFixed(2) : undefined }); }, [playing.value, now]);

  const seek = (at: number): void => { time.value = Math.max(0, Math.min(timeline.total, at)); };
  const play = (): void => { if (!playing.value && now >= timeline.total) seek(0); playing.value = !playing.value; };
  const jump = (by: number): void => seek((timeline.spans[Math.max(0, (span?.step ?? 0) + by)]?.from ?? 0) + 1e-6);
  return (
    <div class="cellview">
      <div class="left">
        <View3d label={words.scene} name="cell" box={() => scene.current?.box() ?? null} onStage={setStage}
          tools={<Button aria-pressed={beams.value} onClick={() => { beams.value = !beams.value; }}>{text.plan.frustums}</Button>} />
        <div class="player">
          <span class="actions">
            <Button onClick={() => jump(-1)} aria-label={words.previous}>‹</Button>
            <Button kind="primary" onClick={play}>{playing.value ? words.pause : words.play}</Button>
            <Button onClick={() => jump(1)} aria-label={words.nextStep}>›</Button>
          </span>
          <input type="range" aria-label={words.time} min={0} max={timeline.total} step={0.01} value={now} aria-valuetext={seconds(now)} onInput={(event) => seek(event.currentTarget.valueAsNumber)} />
          <output class="number">{now.toFixed(1)} / {timeline.total.toFixed(1)} s</output>
          <Select label={words.speed} hideLabel value={String(speed.value)} onChange={(value) => { speed.value = Number(value); }} options={SPEEDS.map((value) => [String(value), `${value}×`])} />
        </div>
      </div>
      <aside class="side">
        {loaded.programs.length > 1 && <Select label={words.setupLabel} value={String(setup)} onChange={(value) => { seek(0); setQuery({ setup: value, t: undefined }); }}
          options={loaded.programs.map((_, i) => [String(i), words.setup(i + 1)])} />}
        <NowFacts loaded={loaded} scene={scene.current} configuration={configuration} viewpoint={span?.op === "scan" ? span.viewpoint : undefined} />
        <ClearanceFacts clearances={clearances} now={now} onSeek={seek} />
        <h2>{words.steps}</h2>
        <Steps timeline={timeline} at={span?.step ?? 0} onStep={(step) => seek(timeline.spans[step]!.from + 1e-6)} />
        <JointPlots loaded={loaded} timeline={timeline} now={now} onPick={seek} />
        <p class="soft">{words.interpolation}</p>
        <ReachPanel stage={stage} load={() => loaded.model} />
      </aside>
    </div>
  );
}

function NowFacts({ loaded, scene, configuration, viewpoint }: { loaded: Loaded; scene: CellScene | null; configuration: number[]; viewpoint: number | undefined }) {
  const view = loaded.plan.viewpoints.find((view) => view.id === viewpoint);
  const off = viewpoint !== undefined ? scene?.offPlan(viewpoint, configuration) : null;
  return (
    <dl class="facts-list" id="now">
      <dt>{words.table}</dt><dd>{(configuration[6] ?? 0).toFixed(1)}°</dd>
      <dt>{words.atScan}</dt><dd>{view ? `${text.plan.view(view.id)} (${view.label})` : text.none}</dd>
      {off && <><dt>{words.error}</dt><dd data-off={off.mm}>{fine(off.mm)}, {off.deg.toFixed(3)}°</dd></>}
      {view?.station?.clearance_mm != null && <><dt>{words.clearance}</dt><dd>{length(view.station.clearance_mm)}</dd></>}
      {view?.station?.posture && <><dt>{words.posture}</dt><dd>{view.station.posture}</dd></>}
    </dl>
  );
}

const CURVE = "#0072b2";

function ClearanceFacts({ clearances, now, onSeek }: { clearances: Clearances; now: number; onSeek: (time: number) => void }) {
  const { curve, now: nearest, share, minMm, failure } = clearances;
  const lines = useMemo(() => curve && [{ label: words.nearest, values: curve.mm.map(lengthIn), colour: CURVE },
    { label: words.kept, values: curve.mm.map(() => lengthIn(minMm)), isDashed: true, isFaint: true, colour: "#d55e00" }], [curve, unit.value]);
  return (
    <section id="clearance" data-mm={nearest?.mm} aria-label={words.nearest}>
      <h2>{words.nearest}</h2>
      {failure && <p class="problem" role="alert">{failure}</p>}
      <p>{nearest ? <><strong>{length(nearest.mm)}</strong> {words.between(nearest.a, nearest.b)}</> : curve ? words.farther(length(FARTHEST_MM)) : !failure && text.loading}</p>
      {curve ? (
        <>
          <p>{words.least} <button type="button" class="link" onClick={() => onSeek(curve.x[curve.least]!)}>
            {length(curve.mm[curve.least]!)}, {curve.x[curve.least]!.toFixed(1)} s</button></p>
          <Chart title={words.nearestOver} x={curve.x} lines={lines!} xLabel="s" yLabel={lengthUnit()} height={120} cursor={now} onPick={onSeek} legend={false} />
        </>
      ) : !failure && <p class="soft" role="status">{words.measuring(percent(share, 0))}</p>}
      <p class="soft">{words.nearestHint(length(minMm))}</p>
    </section>
  );
}

function Steps({ timeline, at, onStep }: { timeline: Timeline; at: number; onStep: (step: number) => void }) {
  const list = useRef<HTMLOListElement>(null);
  useEffect(() => {
    const [holder, item] = [list.current, list.current?.children[at] as HTMLElement | undefined];
    if (holder && item) holder.scrollTop = item.offsetTop - holder.offsetTop - holder.clientHeight / 2;
  }, [at]);
  return (
    <ol class="steps" ref={list} aria-label={words.steps}>
      {timeline.spans.map((span) => (
        <li key={span.step} class={span.step === at ? "now" : ""}>
          <button type="button" class="row" aria-current={span.step === at ? "step" : undefined} onClick={() => onStep(span.step)}>
            <span>{span.step}. {span.op === "scan" ? words.scan(span.viewpoint!) : span.op === "settle" ? words.settle : words.move}</span>
            <span class="number">{span.from.toFixed(1)} s</span>
          </button>
        </li>
      ))}
    </ol>
  );
}

const PLOT_POINTS = 400;

function JointPlots({ loaded, timeline, now, onPick }: { loaded: Loaded; timeline: Timeline; now: number; onPick: (time: number) => void }) {
  const { times, values } = useMemo(() => sampled(timeline, PLOT_POINTS), [timeline]);
  const { robot, table } = loaded.model;
  const limits = [...robot.joints, ...(table.rotation.kind === "limited" ? [{ min_deg: table.rotation.min_deg!, max_deg: table.rotation.max_deg! }] : [])];
  const plots = useMemo(() => values.map((angles, i) => {
    const limit = limits[i];
    return {
      title: i < 6 ? words.joint(i + 1) : words.table,
      lines: [{ label: i < 6 ? words.joint(i + 1) : words.table, values: angles, colour: LINES[i]! },
        ...(limit ? [limit.min_deg, limit.max_deg].map((deg) => ({ label: words.limits, values: angles.map(() => deg), isDashed: true, isFaint: true, colour: "#d55e00" })) : [])],
    };
  }), [values]);
  return (
    <div class="plots">
      <h2>{words.plots}</h2>
      {plots.map((plot) => <Chart key={plot.title} title={plot.title} x={times} lines={plot.lines} xLabel="s" yLabel="°" height={105} cursor={now} onPick={onPick} legend={false} />)}
    </div>
  );
}

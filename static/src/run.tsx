// Runs: what moves, by whose leave, where it is against where it should be; and what to do when it stops.
import { useSignal, type Signal } from "@preact/signals";
import { useEffect, useLayoutEffect, useMemo, useRef, useState } from "preact/hooks";
import { apiPath, ask, askSeen, post, Refused, remove, type Job, type Plan, type Program, type Run, type RunSample, type StepRecord } from "./api";
import { CellScene, cellModelOf } from "./cellscene";
import { programsOf } from "./cell";
import { Chart } from "./chart";
import { JobLink } from "./joblist";
import { partName, readJob } from "./jobs";
import { giveBack, lease, takeLease, withToken } from "./lease";
import { giveWay, Stream, type LiveEvent } from "./live";
import { coverageBytes, fixtureOf, preview } from "./mesh";
import { LINES } from "./palette";
import { hrefOf, percent, seconds, sentence, when, zoned } from "./settings";
import { STANDARD_VIEWS, type Stage } from "./stage";
import { StartRun } from "./startrun";
import { text } from "./text";
import { Button, ConfirmButton, Cut, guarded, Pending, Problem, Slider, useLoaded, useNewest } from "./widgets";
import { View3d } from "./view3d";

const words = text.runs;
const OVER = ["done", "stopped", "failed"];
const stateName = (state: string): string => words.states[state] ?? state;

export function RunList(_: object) {
  const { value, error, told, reload, more } = useNewest<Run>("/runs");
  // After the answer: a list that takes longer is not given up for the next one.
  useEffect(() => {
    const timer = setTimeout(reload, 5000);
    return () => clearTimeout(timer);
  }, [told]);
  return (
    <section class="runs" aria-labelledby="runs-title">
      <h1 id="runs-title">{words.title}</h1>
      <p class="safety">{words.safety}</p>
      {error ? <Problem error={error} /> : !value && <Pending />}
      {value && value.items.length === 0 && <p class="empty">{words.empty}</p>}
      {value && value.items.length > 0 && (
        <div class="scroll" tabIndex={0} role="group" aria-label={words.title}>
          <table>
            <thead><tr>{[zoned(words.started), words.state, words.mode, text.create.cell, words.progress, words.job].map((name) => <th key={name} scope="col">{name}</th>)}<th scope="col"><span class="hidden">{words.remove}</span></th></tr></thead>
            <tbody>{value.items.map((run) => (
              <tr key={run.id}>
                <td><a href={hrefOf(["runs", run.id])}>{when(run.created_at)}</a></td><td><span class={`state ${run.state}`}>{stateName(run.state)}</span></td>
                <td>{words.modes[run.mode]}</td><td>{run.cell}</td><td class="number">{run.step} {words.of} {run.steps}</td>
                <td class="name">{run.job_id && <JobLink id={run.job_id} />}</td>
                <td>{OVER.includes(run.state) && <ConfirmButton label={words.remove} aria-label={`${words.remove} ${when(run.created_at)}`} sure={text.sure(words.oneOf(when(run.created_at)))} onConfirm={() => remove(`/runs/${run.id}`).then(reload)} />}</td>
              </tr>
            ))}</tbody>
          </table>
        </div>
      )}
      {value && <Cut page={value} onMore={more} />}
    </section>
  );
}

/** The run alone is waited for: its controls need nothing else. */
export function RunView({ id }: { id: string }) {
  const { value, error } = useLoaded(() => ask<Run>(`/runs/${id}`), [id]);
  if (error || !value) return <Pending error={error} />;
  return <Live key={id} first={value} />;
}

const orNull = <T,>(asked: Promise<T>): Promise<T | null> => asked.catch(() => null);

/** What is drawn: the cell, and on it what can be read of part, fixture and coverage. */
async function sceneryOf(job: Job) {
  const [model, plan, mesh, bytes] = await Promise.all([
    cellModelOf(job), orNull(ask<Plan>(`/jobs/${job.id}/plan`)), orNull(preview(job.mesh_id)), orNull(coverageBytes(job.id)),
  ]);
  return { model, plan, mesh, bytes, fixture: plan && await orNull(fixtureOf(plan)) };
}

/** What is shown around the controls: each comes, or fails, by itself. */
function useAround(id: string | null) {
  const { value: job, error: noJob } = useLoaded(async () => (id ? readJob(id) : null), [id]);
  const { value: programs } = useLoaded(async () => (job ? programsOf(job) : []), [job]);
  const { value: scenery, error } = useLoaded(async () => (job ? sceneryOf(job) : null), [job]);
  return { job, programs: programs ?? [], scenery, problem: id ? noJob || error : text.notFound };
}

interface LogEntry { at: string; kind: string; state: string; reason: string; step: number; detail?: string | null }
const MAX_SAMPLES = 3000;

/** True for the answer that there is no such run: it was deleted. */
const isGone = (answer: unknown): boolean => answer instanceof Refused && answer.status === 404;

/** What was measured at a time of the steps' clock, which pauses stop; s. */
interface Point { secs: number; step: number; deviation_deg: number; measured: RunSample["measured"] }

/** The ends of the steps that are recorded. */
function pointsOf(record: StepRecord[]): Point[] {
  let secs = 0;
  return record.map(({ step, actual_secs: spent, axis_deviation_deg, measured }) => ({ secs: (secs += spent), step, deviation_deg: axis_deviation_deg, measured }));
}
const MAX_LOG = 300;
/** Distance from the end of the log at which a reader is still at its end, pixels. */
const LOG_SLACK_PX = 12;

/** Live state of a run: its document, samples and events. */
function useRun(first: Run) {
  const run = useSignal(first);
  const samples = useSignal<Point[]>([]);
  const heard = useRef<{ sequence: number; secs: number } | null>(null);
  const log = useSignal<LogEntry[]>([]);
  // The end is told before the record with the coverage is stored; the server answers when it is.
  // On a busy machine that may take longer than one wait, which is over when the view is left.
  const left = useMemo(() => new AbortController(), []);
  // What was measured before the page was opened stands in the record, up to this step.
  const recorded = useRef(-1);
  const readRecord = (): Promise<void> => ask<{ steps: StepRecord[] }>(`/runs/${first.id}/record`).then(({ steps }) => {
    const past = pointsOf(steps);
    const { step, secs } = past.at(-1) ?? { step: -1, secs: 0 };
    // A step that was stopped is in no record.
    const since = samples.peek().filter((point) => point.step > step);
    recorded.current = step;
    samples.value = [...past, ...since.map((point) => ({ ...point, secs: point.secs - since[0]!.secs + secs }))];
  }, () => {});
  useEffect(() => {
    void readRecord();
    return () => left.abort();
  }, []);
  // Of two answers the one that was asked for last is the newer, whichever comes first.
  const turns = useRef({ asked: 0, shown: 0 }).current;
  const read = async (isEnd = false): Promise<void> => {
    for (;;) {
      const turn = (turns.asked += 1);
      const asked = isEnd ? askSeen<Run>(`/runs/${first.id}?wait=20s`, left.signal) : ask<Run>(`/runs/${first.id}`);
      const fresh = await asked.catch((error: unknown) => error);
      if (isGone(fresh)) return;
      if (!(fresh instanceof Error)) {
        const told = fresh as Run;
        // An answer that was under way at the end is older than the end.
        if (turn > turns.shown && (OVER.includes(told.state) || !OVER.includes(run.peek().state))) [run.value, turns.shown] = [told, turn];
        // The record has the time of each step; the curves so far are as the page counted it.
        if (OVER.includes(told.state)) return readRecord();
      }
      if (!isEnd || left.signal.aborted) return;
      await new Promise((tried) => { setTimeout(tried, 1000); });
    }
  };
  const stream = useMemo(() => new Stream({
    path: `/runs/${first.id}/events`, numbered: false, onReset: () => void read(),
    onEvent: ({ kind, data }: LiveEvent) => {
      if (kind === "live") {
        const { sequence, elapsed_secs: real, step, state, deviation_deg, measured } = data as RunSample;
        const [before, known, last] = [heard.current, samples.peek(), samples.peek().at(-1)];
        if (sequence <= (before?.sequence ?? -1)) return;
        heard.current = { sequence, secs: real };
        // The record has it.
        if (step <= recorded.current) return;
        const spent = before && state === "running" ? (real - before.secs) * run.peek().time_factor : 0;
        // Half of the samples goes when there are too many, so that an hour takes no more memory than a minute; a pause takes one.
        const kept = known.length >= MAX_SAMPLES ? known.filter((_, i) => i % 2 === 0) : spent > 0 ? known : known.slice(0, -1);
        samples.value = [...kept, { secs: (last?.secs ?? 0) + spent, step, deviation_deg, measured }];
        if (!OVER.includes(run.peek().state)) run.value = { ...run.peek(), step, state };
        return;
      }
      log.value = [...log.peek().slice(-MAX_LOG), { ...(data as LogEntry), kind }];
      void read(OVER.includes((data as LogEntry).state));
    },
  }), [first.id]);
  useEffect(() => () => stream.close(), [stream]);
  return { run, samples, log, stream, read, recorded };
}

function Live({ first }: { first: Run }) {
  const { run, samples, log, stream, read, recorded } = useRun(first);
  const { job, programs, scenery, problem } = useAround(first.job_id);
  const scene = useRef<CellScene | null>(null);
  const [stage, setStage] = useState<Stage | null>(null);
  const program = programs[run.value.setup] ?? programs[0];
  const last = samples.value.at(-1);
  const { last_measured: left } = run.value;
  // Without it, where a run came to rest is known only to a page that saw it; the record has the ends of its steps.
  const isSeen = last !== undefined && last.step > recorded.current;
  const shown = !OVER.includes(run.value.state) ? words.ghost : left || isSeen ? words.lastMeasured : last ? words.lastStep : words.neverMeasured;
  useEffect(() => { window.vantage.run = { scene, run, samples }; }, []);
  useEffect(() => {
    if (!stage || !scenery) return undefined;
    const { model, plan, mesh, bytes, fixture } = scenery;
    const made = new CellScene(stage, model, plan);
    scene.current = made;
    const tableFromPart = plan?.cell && (plan.setups?.[run.peek().setup]?.table_from_part ?? plan.cell.table_from_part);
    if (mesh && tableFromPart) made.showPart(mesh, bytes, fixture, tableFromPart);
    stage.look(made.box(), STANDARD_VIEWS.iso!);
    return () => { made.dispose(); scene.current = null; };
  }, [stage, scenery]);
  useEffect(() => {
    const measured = left ?? last?.measured;
    if (measured) scene.current?.pose([...measured.joints_deg, measured.table_angle_deg]);
    const target = program && targetOf(program, run.value.step);
    scene.current?.showGhost(OVER.includes(run.value.state) ? null : target ?? null);
  }, [stage, scenery, program, left, last, run.value.step, run.value.state]);
  return (
    <div class="runview">
      <div class="left">
        {scenery ? <View3d label={text.cell.scene} name="run" box={() => scene.current?.box() ?? null} onStage={setStage} />
          : problem ? <p class="empty" role="alert">{problem}</p> : <p class="empty" role="status">{text.loading}</p>}
        <p id="shown" class="soft">{shown}</p>
      </div>
      <aside class="side">
        <h1>{job ? <a href={hrefOf(["jobs", job.id])}>{partName(job)}</a> : run.value.id.slice(0, 8)} <span id="run-state" class={`state ${run.value.state}`}>{stateName(run.value.state)}</span></h1>
        <p class="safety">{words.safety}</p>
        {stream.connection.value === "lost" && !OVER.includes(run.value.state) && <p class="problem" role="alert">{text.connection.lostLong}</p>}
        <Controls run={run} setups={programs.length} read={() => read()} />
        <RunFacts run={run.value} program={program} elapsed={OVER.includes(run.value.state) ? run.value.elapsed_secs : last?.secs ?? run.value.elapsed_secs} />
        <Plots samples={samples} />
        <h2>{zoned(words.log)}</h2>
        <Log entries={log.value} />
        <Files run={run.value} />
      </aside>
    </div>
  );
}

/** Events, of which the newest is in view as long as the reader is at the end. */
function Log({ entries }: { entries: LogEntry[] }) {
  const list = useRef<HTMLOListElement>(null);
  const isAtEnd = useRef(true);
  useLayoutEffect(() => { if (isAtEnd.current) list.current!.scrollTop = list.current!.scrollHeight; }, [entries]);
  return (
    <ol class="log" tabIndex={0} aria-label={words.log} ref={list}
      onScroll={({ currentTarget: { scrollTop, scrollHeight, clientHeight } }) => { isAtEnd.current = scrollHeight - scrollTop - clientHeight < LOG_SLACK_PX; }}>
      {entries.map((entry, i) => (
        <li key={i}>{new Date(entry.at).toLocaleTimeString()} {entry.kind} {stateName(entry.state)}, {words.progress.toLowerCase()} {entry.step}{entry.detail ? `: ${entry.detail}` : ""}</li>
      ))}
    </ol>
  );
}

/** Joints and table angle that a step ends at. */
function targetOf(program: Program, step: number): number[] {
  for (let at = Math.min(step, program.steps.length - 1); at >= 0; at -= 1) {
    const one = program.steps[at]!;
    if (one.op === "move_joints") return [...one.joints_deg!, one.table_angle_deg!];
  }
  return program.home_deg;
}

function LeaseBox({ run }: { run: Run }) {
  const { value, error, reload } = useLoaded(() => ask<{ items: { cell: string; holder: string }[] }>("/leases"), [lease.value]);
  const [name, cell] = [useSignal(""), useSignal("")];
  const held = value?.items.find((item) => item.cell === run.cell);
  const isMine = lease.value?.cell === run.cell;
  const isToArm = run.mode === "live" && run.state === "ready";
  return (
    <fieldset>
      <legend>{words.lease}</legend>
      <p id="lease-state" role="status">{isMine ? words.mine : held ? words.held(held.holder) : value ? words.free : error || text.loading} · <span class="soft">{words.noLease}</span></p>
      <label><span>{words.operator}</span><input type="text" name="operator" maxLength={128} value={name.value} onInput={(event) => { name.value = event.currentTarget.value; }} /></label>
      {isToArm && <label><span>{words.armCell}</span><input type="text" name="cell" maxLength={128} autocomplete="off" value={cell.value} onInput={(event) => { cell.value = event.currentTarget.value; }} /></label>}
      <p class="actions">
        {isMine ? <Button onClick={() => giveBack().then(reload)}>{words.give}</Button> : <Button onClick={() => takeLease(run.cell, name.value).then(reload)}>{words.take}</Button>}
        {isToArm && (
          <Button kind="danger" disabled={!isMine || !name.value || !cell.value} onClick={() => post(withToken(`/runs/${run.id}/arm`), { cell: cell.value, operator: name.value })}>{words.arm}</Button>
        )}
      </p>
    </fieldset>
  );
}

/** Time after which the reader hears that Stop is not answered; the server answers within 2 s. */
const STOP_ANSWER_MS = 4000;

interface Commanded { run: Signal<Run>; read: () => Promise<void> }

/** The speed in force; while one is asked for, that. One request is under way at a time, and the last value wins. */
function Speed({ run, read }: Commanded) {
  const wanted = useSignal<number | null>(null);
  const { id, mode, cell, speed_override: inForce } = run.value;
  const send = async (value: number): Promise<void> => {
    const told = await guarded(() => post<Run>(withToken(`/runs/${id}/override`), { speed_override: value }));
    if (told) run.value = { ...run.peek(), speed_override: told.speed_override };
    else await read();
    const next = wanted.peek()!;
    if (next !== value) return send(next);
    wanted.value = null;
  };
  const choose = (value: number): void => {
    const isFirst = wanted.peek() === null;
    wanted.value = value;
    if (isFirst) void send(value);
  };
  const speed = wanted.value ?? inForce;
  return <Slider label={words.override} min={0.01} max={1} step={0.01} value={speed} show={percent(speed, 0)} disabled={mode === "live" && lease.value?.cell !== cell} onInput={choose} />;
}

function Controls({ run, setups, read }: Commanded & { setups: number }) {
  const said = useSignal("");
  const { id, state, mode, reason, job_id: job, single_step: isStepped } = run.value;
  // Told where the part lies, the run goes on by itself; on its way to rest it takes no order.
  const isWaiting = reason !== "stopping" && ((state === "armed" && isStepped) || (state === "paused" && reason !== "locating"));
  const command = (name: string, token: boolean) => () => post(token ? withToken(`/runs/${id}/${name}`) : `/runs/${id}/${name}`).then(read);
  const isActive = !OVER.includes(state);
  // It can be pressed again as long as the run is not over, whatever waits.
  const stop = async (): Promise<void> => {
    said.value = words.stopping;
    const timer = setTimeout(() => { said.value = words.stopLate; }, STOP_ANSWER_MS);
    const stopped = guarded(() => post(`/runs/${id}/stop`));
    giveWay();
    const isSent = (await stopped) !== undefined;
    clearTimeout(timer);
    said.value = isSent ? "" : words.stopLate;
    await read();
  };
  return (
    <>
      <div class="controls" role="group" aria-label={words.title}>
        <Button idle={state !== "running"} onClick={command("pause", false)}>{words.pause}</Button>
        <Button kind="primary" idle={!isWaiting} onClick={command("resume", true)}>{words.resume}</Button>
        <Button kind="danger" idle={!isActive} onClick={() => { void stop(); }}>{words.stop}</Button>
        {isStepped && <Button idle={!isWaiting} onClick={command("step", true)}>{words.step}</Button>}
        {!isActive && job && setups > 0 && (
          <StartRun job={job} setups={setups} setup={run.value.setup} timeFactor={run.value.time_factor} fromStep={state === "done" ? 0 : run.value.step} />
        )}
      </div>
      {isActive && said.value && <p class={said.value === words.stopLate ? "problem" : "soft"} role="alert">{said.value === words.stopLate && mode === "live" && `${words.pressStop} `}{said.value}</p>}
      {isActive && <Speed run={run} read={read} />}
      {(mode === "live" || lease.value) && <LeaseBox run={run.value} />}
      {state === "failed" || state === "stopped" || state === "paused" || run.value.reason === "stopping" ? <Reason run={run.value} /> : null}
    </>
  );
}

function Reason({ run }: { run: Run }) {
  const help = words.help[run.reason];
  return (
    <p class={run.state === "failed" ? "problem" : "warning"}>
      {sentence(run.detail ? `${stateName(run.state)}: ${run.detail}` : stateName(run.state))}
      {help && <><br />→ {help}</>}{run.mode === "live" && OVER.includes(run.state) && <><br />→ {words.liveOverApi}</>}
    </p>
  );
}

function RunFacts({ run, program, elapsed }: { run: Run; program: Program | undefined; elapsed: number }) {
  // The server counts the scans at the end.
  const scans = OVER.includes(run.state) || !program ? run.scans : program.steps.slice(run.from_step, run.step).filter(({ op }) => op === "scan").length;
  return (
    <>
      <progress max={run.steps} value={run.step} aria-label={words.progress} />
      <dl class="facts-list">
        <dt>{words.mode}</dt><dd>{words.modes[run.mode]}{run.mode === "simulate" && run.time_factor !== 1 ? `, ${run.time_factor}×` : ""}</dd>
        <dt>{text.cell.setupLabel}</dt><dd id="run-setup">{run.setup + 1}</dd>
        <dt>{words.progress}</dt><dd id="run-progress">{run.step} {words.of} {run.steps}, {words.scans(scans)}</dd>
        <dt>{words.elapsed}</dt><dd>{seconds(elapsed)} {words.of} {seconds(run.planned_secs)}{run.speed_override < 1 && ` ${words.atFullSpeed}`}</dd>
        {run.coverage && <><dt>{words.coverage}</dt><dd>{percent(run.coverage.measured_of_asked, 2)} ({words.planned} {percent(run.coverage.planned_of_asked, 2)})</dd></>}
        {run.jitter && <><dt>{words.jitter}</dt><dd>{run.jitter.p99_ms?.toFixed(2)} ms</dd></>}
        {run.armed_by && <><dt>{words.armedBy}</dt><dd>{run.armed_by}</dd></>}
      </dl>
      {run.objections.length > 0 && <><h2>{words.objections}</h2><ul>{run.objections.map((objection) => <li key={objection} class="problem">{objection}</li>)}</ul></>}
    </>
  );
}

const PLOTTED = 600;
/** Deviations of less than the plot's height at least, degrees: rounding alone is not spread over it. */
const LEAST_DEVIATION_DEG = 0.01;

function Plots({ samples }: { samples: Signal<Point[]> }) {
  const all = samples.value;
  const { x, deviation, joints } = useMemo(() => {
    const every = Math.max(1, Math.ceil(all.length / PLOTTED));
    const some = all.filter((_, i) => i % every === 0 || i === all.length - 1);
    return {
      x: some.map(({ secs }) => secs),
      deviation: [{ label: words.deviation, values: some.map((sample) => sample.deviation_deg) }],
      joints: [0, 1, 2, 3, 4, 5, 6].map((i) => ({ label: i < 6 ? `J${i + 1}` : text.cell.table, colour: LINES[i]!,
        values: some.map((sample) => (i < 6 ? sample.measured.joints_deg[i]! : sample.measured.table_angle_deg)) })),
    };
  }, [all]);
  if (x.length < 2) return null;
  return (
    <>
      <Chart title={words.speed} x={x} lines={joints} xLabel="s" yLabel="°" height={170} />
      <Chart title={words.deviation} x={x} lines={deviation} xLabel="s" yLabel="°" height={120} least={LEAST_DEVIATION_DEG} />
    </>
  );
}

function Files({ run }: { run: Run }) {
  if (!OVER.includes(run.state)) return null;
  const link = (path: string, name: string) => <a href={`${apiPath}/runs/${run.id}/${path}`} download>{name}</a>;
  return <p class="actions">{link("record", words.record)}{link("record.csv", words.recordCsv)}{link("audit", words.audit)}</p>;
}

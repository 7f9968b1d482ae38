// Calibrations: those that the server keeps, a new one from a file of observations, and one with its verdict, residuals and poses.
import { useSignal } from "@preact/signals";
import { useEffect, useMemo, useState } from "preact/hooks";
import { apiPath, ask, askSeen, post, putVersion, Refused, remove, type Calibration, type CalibrationFinding, type CalibrationJob, type Page, type Pose, type Residual } from "./api";
import { Chart, type Line } from "./chart";
import { UnitNote, Warnings } from "./job";
import { LINES } from "./palette";
import { fixed, hrefOf, lengthIn, lengthUnit, place, setQuery, unit, when, zoned } from "./settings";
import { text } from "./text";
import { Button, ConfirmButton, Cut, Dialog, goToMade, known, NumberInput, Pending, Problem, Select, useLoaded, useNewest } from "./widgets";

const words = text.calibrations;
const isOpen = ({ state }: CalibrationJob): boolean => state === "queued" || state === "running";
/** Residuals are small: with all the decimals that a data sheet gives them. */
const small = (value: number, decimals = 3): string => (value === 0 ? "0" : Math.abs(value) < 10 ** -decimals ? value.toExponential(1) : value.toFixed(decimals));
const lengthDecimals = (): number => (unit.value === "mm" ? 3 : 5);
const bare = (mm: number): string => small(lengthIn(mm), lengthDecimals());
const smallLength = (mm: number): string => `${bare(mm)} ${lengthUnit()}`;
const deg = (value: number): string => `${small(value)}°`;

interface Names { cells: string[] }
const namesOf = async (): Promise<Names> => ({ cells: (await ask<Page<{ name: string }>>("/cells")).items.map(({ name }) => name) });

export function CalibrationList() {
  const { value, error, reload, more } = useNewest<CalibrationJob>("/calibrations");
  useEffect(() => {
    if (!value?.items.some(isOpen)) return undefined;
    const timer = setTimeout(reload, 1000);
    return () => clearTimeout(timer);
  }, [value]);
  return (
    <section class="runs calibrations" aria-labelledby="calibrations-title">
      <h1 id="calibrations-title">{words.title}</h1>
      <p class="soft">{words.hint}</p>
      {error ? <Problem error={error} /> : !value && <Pending />}
      <NewCalibration />
      {value && (value.items.length === 0 ? <p class="empty">{words.empty}</p> : (
        <div class="scroll" tabIndex={0} role="group" aria-label={words.title}>
          <table>
            <thead><tr>{[zoned(words.started), words.cell, words.state, words.used, words.rmsShift, words.rmsTurn, words.point].map((name) => <th key={name} scope="col">{name}</th>)}<th scope="col"><span class="hidden">{words.remove}</span></th></tr></thead>
            <tbody>{value.items.map((job) => (
              <tr key={job.id}>
                <th scope="row"><a href={hrefOf(["calibrations", job.id])}>{when(job.created_at)}</a></th>
                <td>{job.cell}</td><td><span class={`state ${job.state}`}>{text.states[job.state]}</span></td>
                <td>{job.summary ? words.of(job.summary.used, job.observations) : job.observations}</td>
                <td>{job.summary ? smallLength(job.summary.spread.rms_translation_mm) : text.none}</td>
                <td>{job.summary ? deg(job.summary.spread.rms_rotation_deg) : text.none}</td>
                <td>{job.point_at_best_focus_sd_mm == null ? text.none : smallLength(job.point_at_best_focus_sd_mm)}</td>
                <td>{isOpen(job) ? <Button onClick={() => post(`/calibrations/${job.id}/cancel`).then(reload)}>{words.cancel}</Button>
                  : <ConfirmButton label={words.remove} aria-label={`${words.remove} ${when(job.created_at)}`} sure={text.sure(words.oneOf(job.cell, when(job.created_at)))} onConfirm={() => remove(`/calibrations/${job.id}`).then(reload)} />}</td>
              </tr>
            ))}</tbody>
          </table>
        </div>
      ))}
      {value && <Cut page={value} onMore={more} />}
    </section>
  );
}

function NewCalibration() {
  const { value: names, error } = useLoaded(namesOf, []);
  const file = useSignal<File | null>(null);
  const [cell, setCell] = useState("");
  const [solve, setSolve] = useState("joint");
  const [holdOut, setHoldOut] = useState(0);
  const start = async (): Promise<void> => {
    let data: unknown;
    try {
      data = JSON.parse(await file.value!.text());
    } catch (error) {
      throw new Error(`${words.notJson} ${(error as Error).message}`);
    }
    await goToMade(async () => {
      const made = await post<CalibrationJob>("/calibrations", { data, cell: cell || names!.cells[0], solve, hold_out: holdOut });
      return hrefOf(["calibrations", made.id]);
    });
  };
  if (!names) return error ? <Problem error={error} /> : null;
  return (
    <details class="group">
      <summary>{words.create}</summary>
      <p class="soft">{words.createHint}</p>
      <div class="grid">
        <label><span>{words.file}</span><input type="file" name="observations" accept=".json" onChange={(event) => { file.value = event.currentTarget.files?.[0] ?? null; }} /></label>
        <Select label={words.cell} value={cell || names.cells[0] || ""} onChange={setCell} options={names.cells.map((name) => [name, name])} />
        <Select label={words.solve} value={solve} onChange={setSolve} options={Object.entries(words.solves)} />
        <label><span>{words.holdOut}</span><NumberInput step={1} min={0} max={1000} value={holdOut} onNumber={(value) => setHoldOut(value ?? 0)} /></label>
      </div>
      <p class="actions"><Button kind="primary" disabled={!file.value} onClick={start}>{words.start}</Button></p>
    </details>
  );
}

export function CalibrationView({ id }: { id: string }) {
  const { value: job, error, reload } = useLoaded(() => ask<CalibrationJob>(`/calibrations/${id}`), [id]);
  const isDone = job?.state === "succeeded";
  const { value: result, error: problem } = useLoaded(() => (isDone ? ask<Calibration>(`/calibrations/${id}/result`) : Promise.resolve(null)), [id, isDone]);
  useEffect(() => {
    if (!job || !isOpen(job)) return undefined;
    const left = new AbortController();
    void askSeen(`/calibrations/${id}?wait=30s`, left.signal).catch(() => new Promise((waited) => { setTimeout(waited, 2000); })).then(() => left.signal.aborted || reload());
    return () => left.abort();
  }, [job]);
  if (error || problem || !job) return <Pending error={error || problem} />;
  return (
    <section class="runs calibration" aria-labelledby="calibration-title" data-state={job.state}>
      <div class="title">
        <h1 id="calibration-title">{words.one(job.cell)}</h1>
        <span class={`state ${job.state}`}>{text.states[job.state]}</span>
        <span class="soft">{zoned(when(job.created_at))} · {words.solves[job.solve]}{job.submitted_by && ` · ${text.jobs.by(job.submitted_by)}`}</span>
        {isDone && <a class="button" href={`${apiPath}/calibrations/${id}/report`} target="_blank" rel="noopener">{text.job.report}</a>}
        {isDone && <a class="button" href={`${apiPath}/calibrations/${id}/result`} download={`calibration-${id}.json`}>{words.download}</a>}
      </div>
      {isOpen(job) && <p class="soft" role="status">{text.states[job.state]}…</p>}
      {job.problem && <p class="problem" role="alert">{[job.problem.title, job.problem.detail, ...job.problem.errors.map(({ pointer, detail }) => `${pointer}: ${detail}`)].filter(Boolean).join("\n")}</p>}
      <UnitNote of={[job.problem?.detail, ...(job.problem?.errors ?? []).map(({ detail }) => detail)]} />
      <Verdict job={job} />
      {result ? <Result job={job} result={result} /> : isDone && <Pending />}
    </section>
  );
}

function Verdict({ job }: { job: CalibrationJob }) {
  const { summary, findings, point_at_best_focus_sd_mm: point } = job;
  return (
    <div id="verdict">
      {summary && point != null && <p><strong>{words.verdict(smallLength(point))}</strong> {words.verdictOf(words.of(summary.used, job.observations), smallLength(summary.spread.rms_translation_mm), deg(summary.spread.rms_rotation_deg))}</p>}
      {summary && findings.length === 0 && !job.warnings?.length && <p class="good">{words.noFindings}</p>}
      {findings.map((finding) => <Finding key={finding.code + finding.observations.join()} finding={finding} />)}
      <UnitNote of={findings.map(({ detail }) => detail)} />
      <Warnings of={job.warnings} />
    </div>
  );
}

const Finding = ({ finding }: { finding: CalibrationFinding }) => (
  <p class={finding.severity === "error" ? "problem" : finding.severity === "warning" ? "warning" : ""}>{finding.detail}
    {finding.observations.length > 0 && <span class="soft"> {words.about(finding.observations.join(", "))}</span>}</p>
);

function Result({ job, result }: { job: CalibrationJob; result: Calibration }) {
  return (
    <>
      <Adopt job={job} />
      <div class="columns results">
        <section><h2>{words.residuals}</h2><ResidualPlots residuals={result.residuals} /></section>
        <section>
          <h2>{words.poses}</h2><PoseTable result={result} />
          <h2>{words.knowledge}</h2><Knowledge result={result} />
        </section>
      </div>
      <h2>{words.observations}</h2>
      <Observations residuals={result.residuals} />
    </>
  );
}

/** Stores the calibrated cell under a name; in place of another one only if the operator says so. */
function Adopt({ job }: { job: CalibrationJob }) {
  const { value: cell, error } = useLoaded(() => ask<{ name: string }>(`/calibrations/${job.id}/cell`), [job.id]);
  const [given, setName] = useState<string | null>(null);
  const [said, setSaid] = useState("");
  const [replaced, setReplaced] = useState<string | null>(null);
  const name = given ?? cell?.name ?? "";
  const save = async (etag = ""): Promise<void> => {
    setReplaced(null);
    try {
      await putVersion(`/cells/${encodeURIComponent(name)}`, { ...cell, name }, etag);
      setSaid(name);
    } catch (error) {
      if (!(error instanceof Refused) || error.code !== "precondition_required") throw error;
      setReplaced(error.etag);
    }
  };
  if (error) return <p class="warning" role="alert">{error}</p>;
  return (
    <div class="actions">
      <label><span>{words.adoptAs}</span><input type="text" name="adopt" maxLength={128} value={name} onInput={(event) => { setName(event.currentTarget.value); setSaid(""); }} /></label>
      <Button kind="primary" disabled={!cell || !name} onClick={() => save()}>{words.adopt}</Button>
      {said && <a href={hrefOf(["specs", "cells", said])}>{words.adopted}</a>}
      {replaced !== null && (
        <Dialog title={words.adopt} onClose={() => setReplaced(null)}>
          <p>{words.replaceSure(name)}</p>
          <p class="actions"><Button kind="danger" onClick={() => save(replaced)}>{words.replace}</Button><Button onClick={() => setReplaced(null)}>{text.jobs.cancel}</Button></p>
        </Dialog>
      )}
    </div>
  );
}

const statusOf = (residual: Residual): string =>
  (residual.held_out ? words.heldOut : residual.used ? words.wasUsed : words.dropped(residual.dropped_because ?? ""));

/** One line of points for each fate of an observation, so that colour and legend tell them apart. */
function fates(residuals: Residual[], of: (residual: Residual) => number): Line[] {
  const groups: [string, (residual: Residual) => boolean, string][] = [
    [words.wasUsed, ({ used, held_out: held }) => used && !held, LINES[0]!], [words.heldOut, ({ held_out: held }) => held, LINES[1]!],
    [words.wasDropped, ({ used, held_out: held }) => !used && !held, "#d55e00"]];
  return groups.filter(([, isIn]) => residuals.some(isIn)).map(([label, isIn, colour]) =>
    ({ label, colour, isPoints: true, values: residuals.map((residual) => (isIn(residual) ? of(residual) : null)) }));
}

function ResidualPlots({ residuals }: { residuals: Residual[] }) {
  const plots = useMemo(() => {
    const order = residuals.map((_, i) => i + 1);
    const around = [...residuals].sort((a, b) => a.table_angle_deg - b.table_angle_deg);
    const axes = ["x", "y", "z"].map((axis, i): Line => ({ label: axis, isPoints: true, colour: LINES[i]!, values: residuals.map(({ shift_mm: shift }) => lengthIn(shift[i]!)) }));
    return [
      { title: words.shiftPlot, x: order, lines: fates(residuals, ({ translation_mm: shift }) => lengthIn(shift)), xLabel: words.number, isCounted: true, yLabel: lengthUnit() },
      { title: words.turnPlot, x: order, lines: fates(residuals, ({ rotation_deg: turn }) => turn), xLabel: words.number, isCounted: true, yLabel: "°" },
      { title: words.axesPlot, x: order, lines: axes, xLabel: words.number, isCounted: true, yLabel: lengthUnit() },
      { title: words.tablePlot, x: around.map(({ table_angle_deg: angle }) => angle), lines: fates(around, ({ translation_mm: shift }) => lengthIn(shift)), xLabel: words.tableAngle, yLabel: lengthUnit() },
    ];
  }, [residuals, unit.value]);
  return <>{plots.map((plot) => <Chart key={plot.title} {...plot} height={170} legend />)}</>;
}

function PoseTable({ result }: { result: Calibration }) {
  const rows: [string, Pose | null | undefined][] = [[words.scannerPose, result.flange_from_scanner], [words.tablePose, result.base_from_table], [words.boardPose, result.plate_from_board]];
  return (
    <div class="scroll" tabIndex={0} role="group" aria-label={words.poses}>
      <table>
        <thead><tr><th scope="col">{words.pose}</th><th scope="col">{words.translation(lengthUnit())}</th><th scope="col">{words.quaternion}</th></tr></thead>
        <tbody>{rows.map(([name, pose]) => pose && (
          <tr key={name}><th scope="row">{name}</th><td class="number">{pose.translation_mm.map((value) => fixed(lengthIn(value), lengthDecimals())).join(", ")}</td>
            <td class="number">{pose.quaternion_xyzw.map((value) => value.toFixed(5)).join(", ")}</td></tr>
        ))}</tbody>
      </table>
    </div>
  );
}

function Knowledge({ result }: { result: Calibration }) {
  const { observability, leave_one_out: left, held_out: held, summary, table_runout: runout } = result;
  const weakest = observability.weakest;
  const facts: [string, string][] = [
    [words.sdShift, smallLength(observability.translation_sd_mm)], [words.sdTurn, deg(observability.rotation_sd_deg)],
    [words.spread, observability.spread_deg.map((value) => `${value.toFixed(0)}°`).join(", ")],
    ...(weakest ? [[words.weakest, words.along(weakest.freedom, weakest.axis.map((value) => value.toFixed(2)).join(", "), weakest.sd_mm != null ? smallLength(weakest.sd_mm) : deg(weakest.sd_deg ?? 0))] as [string, string]] : []),
    [words.predicted, `${smallLength(left.spread.rms_translation_mm)}, ${deg(left.spread.rms_rotation_deg)}`],
    ...(held ? [[words.heldOutError, `${smallLength(held.rms_translation_mm)}, ${deg(held.rms_rotation_deg)}`] as [string, string]] : []),
    [words.chi2, summary.chi2_p < 1e-4 ? "< 0.0001" : summary.chi2_p.toFixed(4)],
    [words.sigmaSources[result.arm_sigma_source ?? ""] ?? (result.sigma_estimated ? words.sigmaEstimated : words.sigma), words.sigmas(smallLength(result.sigma.robot_mm), deg(result.sigma.robot_deg), smallLength(result.sigma.board_mm), deg(result.sigma.board_deg))],
    ...runout.map(({ order, radial_mm: radial, axial_mm: axial }) => [words.runout(order), `${smallLength(radial)}, ${smallLength(axial)}`] as [string, string]),
    ...(result.temperature_c == null ? [] : [[words.temperature, `${result.temperature_c} °C`] as [string, string]]),
  ];
  return <dl class="facts-list">{facts.map(([name, value]) => <><dt>{name}</dt><dd>{value}</dd></>)}</dl>;
}

function Observations({ residuals }: { residuals: Residual[] }) {
  const only = known(words.shows, place.value.query.get("only"));
  const shown = residuals.filter(({ used, held_out: held }) => only === "all" || (only === "dropped" ? !used && !held : held));
  return (
    <>
      <Select label={words.show} value={only} onChange={(value) => setQuery({ only: value === "all" ? undefined : value })} options={Object.entries(words.shows)} />
      <div class="scroll" tabIndex={0} role="group" aria-label={words.observations}>
        <table class="observations">
          <thead><tr>{[words.name, words.status, words.shift, ...["x", "y", "z"].map((axis) => `${axis}, ${lengthUnit()}`), words.turn, words.prediction, words.tableAngle].map((name) => <th key={name} scope="col">{name}</th>)}</tr></thead>
          <tbody>{shown.map((residual) => (
            <tr key={residual.id}>
              <th scope="row">{residual.id}</th><td class={residual.used || residual.held_out ? "" : "bad"}>{statusOf(residual)}</td><td>{smallLength(residual.translation_mm)}</td>
              {residual.shift_mm.map((value, i) => <td key={i}>{bare(value)}</td>)}
              <td>{deg(residual.rotation_deg)}</td><td>{residual.predicted_translation_mm == null ? text.none : smallLength(residual.predicted_translation_mm)}</td><td>{residual.table_angle_deg.toFixed(1)}°</td>
            </tr>
          ))}</tbody>
        </table>
      </div>
    </>
  );
}

// Two plans side by side: the parts turn together, figures and settings with their differences.
import type { ComponentChildren } from "preact";
import { useEffect, useMemo, useRef, useState } from "preact/hooks";
import { Box3 } from "three";
import { ask, type Job, type Plan, type Summary } from "./api";
import { colourOfByte, isGrade, meaningOf } from "./bytes";
import { Chart, type Line } from "./chart";
import { facts, hasOwnCycle, StateMark } from "./joblist";
import { jobIds, jobSignal, keepJob, listed, listMore, partName } from "./jobs";
import { coverageBytes, preview, type Preview } from "./mesh";
import { css, DIFFERENCES, LINES, type Rgb } from "./palette";
import { apiDocument, changesOf } from "./schema";
import { area, fixed, goTo, hrefOf, percent, points, when, zone } from "./settings";
import { PartMesh, Stage, STANDARD_VIEWS } from "./stage";
import { text } from "./text";
import { Button, Pending, Problem, Select, Swatch, useLoaded } from "./widgets";
import { View3d } from "./view3d";

const words = text.compare;
interface Side { job: Job; plan: Plan }

async function sideOf(id: string): Promise<Side> {
  const job = await ask<Job>(`/jobs/${id}`);
  keepJob(job);
  return { job, plan: await ask<Plan>(`/jobs/${id}/plan`) };
}

/** What is drawn of the plans: the part and the coverage of its faces by each. */
interface Drawn { mesh: Preview; bytes: Uint8Array[] }

function PartView({ drawn, paint, label, name, onStage, children }: {
  drawn: Promise<Drawn>; paint: (drawn: Drawn, face: number) => Rgb; label: string; name: string; onStage: (stage: Stage | null) => void;
  children?: ComponentChildren;
}) {
  const [stage, setStage] = useState<Stage | null>(null);
  const [problem, setProblem] = useState("");
  const box = useRef<Box3 | null>(null);
  useEffect(() => {
    if (!stage) return;
    void drawn.then((given) => {
      const part = new PartMesh(given.mesh);
      part.paint((face) => paint(given, face));
      stage.scene.add(part.mesh);
      box.current = part.box;
      stage.look(part.box, STANDARD_VIEWS.iso!);
    }, (error: Error) => setProblem(error.message));
  }, [stage]);
  return <View3d label={label} name={name} box={() => box.current} onStage={(made) => { setStage(made); onStage(made); }}>{problem && <p class="problem" role="alert">{problem}</p>}{children}</View3d>;
}

/** Which of two plans measure a face, by its bytes; a face is not asked for where neither asks for it. */
export function measuredBy(one: number, two: number): keyof typeof DIFFERENCES {
  if (one === 255 && two === 255) return "not_asked";
  const [byOne, byTwo] = [one, two].map((byte) => isGrade(meaningOf(byte)));
  return byOne ? (byTwo ? "both" : "first") : byTwo ? "second" : "neither";
}

/** Areas by which plan measures them. */
function DifferenceLegend({ drawn, isOfOpen }: { drawn: Promise<Drawn>; isOfOpen: boolean }) {
  const { value } = useLoaded(() => drawn, [drawn]);
  const areas = useMemo(() => {
    const sums = Object.fromEntries(Object.keys(DIFFERENCES).map((key) => [key, 0]));
    value?.mesh.areas.forEach((size, face) => { sums[measuredBy(value.bytes[0]![face]!, value.bytes[1]![face]!)]! += size; });
    return sums;
  }, [value]);
  const total = Object.values(areas).reduce((sum, size) => sum + size, 0);
  if (!value) return null;
  return (
    <div class="legend" tabIndex={0} role="group" aria-label={text.plan.legend}>
      <table aria-label={text.plan.legend}><tbody>{Object.entries(DIFFERENCES).filter(([key]) => areas[key]! > 0).map(([key, colour]) => (
        <tr key={key} data-key={key} data-mm2={areas[key]}><th scope="row"><Swatch colour={css(colour)} /> {key === "not_asked" && isOfOpen ? text.plan.notOpen : words.measuredBy[key]}</th>
          <td class="number">{area(areas[key]!)}</td><td class="number">{percent(areas[key]! / total)}</td></tr>
      ))}</tbody></table>
    </div>
  );
}

/** Figures of a summary by name; shares are in 0 to 1. The cycle is that of the robot's program where it is another for one of two. */
function figuresOf(summary: Summary, isProgram: boolean): Record<string, { value: number | null; isShare: boolean }> {
  const share = (value: number) => ({ value, isShare: true });
  const count = (value: number | null) => ({ value, isShare: false });
  return {
    views: count(summary.views), of_visible: share(summary.coverage.of_visible), of_asked: share(summary.coverage.of_asked),
    of_coverable: share(summary.coverage.of_coverable), A: share(summary.grades.A ?? 0), B: share(summary.grades.B ?? 0),
    C: share(summary.grades.C ?? 0), D: share(summary.grades.D ?? 0),
    ...(isProgram ? { program: count(summary.program_cycle?.cycle_secs ?? null) } : { cycle: count(summary.cycle_secs) }), setups: count(summary.setups),
  };
}

/** True of further views, whose shares are of the area that earlier scans left open. */
const isOpen = ({ job }: Side): boolean => job.summary?.of_open === true;

function FigureTable({ sides }: { sides: [Side, Side] }) {
  const [areOpen, hasOtherWhole] = [sides.every(isOpen), sides.some(isOpen) && !sides.every(isOpen)];
  const isProgram = sides.some(({ job }) => hasOwnCycle(job.summary!));
  const [one, two] = sides.map(({ job }) => figuresOf(job.summary!, isProgram)) as [ReturnType<typeof figuresOf>, ReturnType<typeof figuresOf>];
  const show = (value: number | null, isShare: boolean, name: string): string =>
    (value === null ? text.none : isShare ? percent(value, 2) : name === "cycle" || name === "program" ? `${fixed(value, 1)}\u00a0s` : fixed(value, 0));
  return (
    <table>
      <thead><tr><th scope="col">{words.figure}</th><th scope="col">{words.first}</th><th scope="col">{words.second}</th><th scope="col">{words.difference}</th></tr></thead>
      <tbody>{Object.entries(one).map(([name, { value, isShare }]) => {
        const other = two[name]!.value;
        const difference = value === null || other === null || (isShare && hasOtherWhole) ? null : other - value;
        return (
          <tr key={name}><th scope="row">{(areOpen && words.openFigures[name]) || words.figures[name]}</th><td class="number">{show(value, isShare, name)}</td><td class="number">{show(other, isShare, name)}</td>
            <td class="number">{difference === null ? text.none : isShare ? words.points(points(difference)) : `${difference > 0 ? "+" : ""}${show(difference, false, name)}`}</td></tr>
        );
      })}</tbody>
    </table>
  );
}

function SettingsTable({ sides }: { sides: [Side, Side] }) {
  const { value: api } = useLoaded(apiDocument, []);
  if (!api) return null;
  const [one, two] = sides.map(({ job }) => changesOf(api, job.params ?? {})) as [Record<string, unknown>, Record<string, unknown>];
  const names = [...new Set([...Object.keys(one), ...Object.keys(two)])].filter((name) => JSON.stringify(one[name]) !== JSON.stringify(two[name]));
  const show = (value: unknown): string => (value === undefined ? text.create.default : JSON.stringify(value).slice(0, 120));
  if (names.length === 0) return <p class="soft">{words.same}</p>;
  return (
    <table><thead><tr><td /><th scope="col">{words.first}</th><th scope="col">{words.second}</th></tr></thead><tbody>{names.map((name) => <tr key={name}><th scope="row"><code>{name}</code></th><td><code>{show(one[name])}</code></td><td><code>{show(two[name])}</code></td></tr>)}</tbody></table>
  );
}

function Pair({ sides }: { sides: [Side, Side] }) {
  const isSamePart = sides[0].job.mesh_id === sides[1].job.mesh_id;
  const count = isSamePart ? 3 : 2;
  const stages = useRef<(Stage | null)[]>([]);
  const couple = (at: number) => (stage: Stage | null): void => {
    stages.current[at] = stage;
    const made = stages.current.filter((other) => other !== null);
    if (made.length === count) Stage.couple(...made);
  };
  const [one, two, both] = useMemo(() => {
    const bytes = sides.map(({ job }) => coverageBytes(job.id));
    const drawn = (mesh: string, of: Promise<Uint8Array>[]): Promise<Drawn> =>
      Promise.all([preview(mesh), Promise.all(of)]).then(([mesh, bytes]) => ({ mesh, bytes }));
    return [...sides.map(({ job }, i) => drawn(job.mesh_id, [bytes[i]!])), drawn(sides[0].job.mesh_id, bytes)] as [Promise<Drawn>, Promise<Drawn>, Promise<Drawn>];
  }, [sides]);
  const { x, lines } = useMemo(() => {
    const longest = Math.max(...sides.map(({ plan }) => plan.coverage.curve.length));
    const at = Array.from({ length: longest + 1 }, (_, i) => i);
    const name = (i: number): string => (i ? words.second : words.first);
    const curves = sides.map(({ plan }, i): Line => ({ label: name(i), colour: LINES[i]!, values: at.map((n) => (n === 0 ? 0 : plan.coverage.curve[n - 1] ?? null)) }));
    // What no choice of as many views can do better than.
    const bounds = sides.flatMap(({ plan }, i): Line[] => {
      const upper = plan.bound?.of_asked_upper;
      return typeof upper === "number" ? [{ label: text.plan.boundOf(name(i), percent(upper, 2)), colour: LINES[i]!, values: at.map((n) => (n <= plan.coverage.curve.length ? upper : null)), isDashed: true, isFaint: true }] : [];
    });
    return { x: at, lines: [...curves, ...bounds] };
  }, [sides]);
  return (
    <>
      <div class={isSamePart ? "pair three" : "pair"}>{sides.map((side, i) => (
        <div key={side.job.id} class="view3d">
          <p><a href={hrefOf(["jobs", side.job.id])}>{i ? words.second : words.first}: {partName(side.job)}</a> <StateMark job={side.job} /> <span class="soft">{facts(side.job)}</span></p>
          <PartView drawn={i ? two : one} paint={({ bytes }, face) => colourOfByte(bytes[0]![face]!)} label={partName(side.job)} name={`compare-${i + 1}`} onStage={couple(i)} />
        </div>
      ))}
        {isSamePart && (
          <div class="view3d">
            <p>{words.map}</p>
            <PartView drawn={both} paint={({ bytes }, face) => DIFFERENCES[measuredBy(bytes[0]![face]!, bytes[1]![face]!)]} label={words.map} name="compare-difference" onStage={couple(2)}>
              <DifferenceLegend drawn={both} isOfOpen={sides.some(isOpen)} />
            </PartView>
          </div>
        )}
      </div>
      <p class="soft">{words.coupled} {!isSamePart && words.otherPart}</p>
      <div class="pair">
        <section><FigureTable sides={sides} />{sides.map((side, i) => isOpen(side) && <p key={side.job.id} class="soft">{words.open(i ? words.second : words.first)}</p>)}</section>
        <section>
          <Chart title={text.plan.curve} x={x} lines={lines} xLabel={text.plan.views} yLabel={sides.every(isOpen) ? text.jobs.open : text.jobs.asked} percent yRange={[0, 1]} points />
          <h2>{words.settings}</h2><SettingsTable sides={sides} />
        </section>
      </div>
    </>
  );
}

/** Address of two jobs; `-` where one is not chosen yet. */
const pair = (first: string, second: string): string => hrefOf(["compare", first || "-", second || "-"]);

export function Compare({ first: one, second: two }: { first: string; second: string }) {
  const [first, second] = [one, two].map((id) => (id === "-" ? "" : id)) as [string, string];
  const { value: read, error } = useLoaded(async () => ({ of: one + two, sides: first && second ? await Promise.all([sideOf(first), sideOf(second)]) : null }), [first, second]);
  // The pair before is not shown for this one while that is read, or cannot be.
  const value = read?.of === one + two ? read.sides : null;
  const choices = jobIds.value.map((id) => jobSignal(id)!.value).filter((job) => job.state === "succeeded")
    .map((job): [string, string] => [job.id, `${partName(job)} · ${text.jobs.views(job.summary?.views ?? 0)} · ${when(job.created_at)} · ${facts(job)}`]);
  const pick = (label: string, chosen: string, onChange: (id: string) => void) => (
    <Select label={label} value={chosen} onChange={onChange} options={[["", words.pick], ...choices]} />
  );
  return (
    <section class="compare" aria-labelledby="compare-title">
      <div class="title">
        <h1 id="compare-title">{words.title}</h1>
        {pick(words.first, first, (id) => goTo(pair(id, second)))}{pick(words.second, second, (id) => goTo(pair(first, id)))}
        <Button onClick={() => goTo(pair(second, first))}>{words.swap}</Button>
        {listed.value?.token && <Button onClick={listMore}>{text.jobs.older}</Button>}
        <span class="soft">{text.times(zone)}</span>
      </div>
      {error && <Problem error={error} />}
      {!value && !error && (first && second ? <Pending /> : <p class="empty">{words.pickTwo}</p>)}
      {value && <Pair key={value.map(({ job }) => job.id).join()} sides={value} />}
    </section>
  );
}

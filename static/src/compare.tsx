// Two plans side by side: the parts turn together, figures and settings with their differences.
import { useEffect, useMemo, useRef, useState } from "preact/hooks";
import { Box3 } from "three";
import { ask, type Job, type Plan, type Summary } from "./api";
import { colourOfByte } from "./bytes";
import { Chart } from "./chart";
import { facts, StateMark } from "./joblist";
import { jobIds, jobSignal, keepJob, partName } from "./jobs";
import { coverageBytes, preview } from "./mesh";
import { apiDocument, changesOf } from "./schema";
import { goTo, hrefOf, percent } from "./settings";
import { PartMesh, Stage, STANDARD_VIEWS } from "./stage";
import { text } from "./text";
import { Button, Select, useLoaded } from "./widgets";
import { View3d } from "./view3d";

const words = text.compare;
interface Side { job: Job; plan: Plan }

async function sideOf(id: string): Promise<Side> {
  const job = await ask<Job>(`/jobs/${id}`);
  keepJob(job);
  return { job, plan: await ask<Plan>(`/jobs/${id}/plan`) };
}

function PartView({ side, name, onStage }: { side: Side; name: string; onStage: (stage: Stage | null) => void }) {
  const [stage, setStage] = useState<Stage | null>(null);
  const box = useRef<Box3 | null>(null);
  useEffect(() => {
    if (!stage) return;
    void Promise.all([preview(side.job.mesh_id), coverageBytes(side.job.id)]).then(([mesh, bytes]) => {
      const part = new PartMesh(mesh);
      part.paint((face) => colourOfByte(bytes[face]!));
      stage.scene.add(part.mesh);
      box.current = part.box;
      stage.look(part.box, STANDARD_VIEWS.iso!);
    });
  }, [stage]);
  return <View3d label={partName(side.job)} name={name} box={() => box.current} onStage={(made) => { setStage(made); onStage(made); }} />;
}

/** Figures of a summary by name; shares are in 0 to 1. */
function figuresOf(summary: Summary): Record<string, { value: number | null; isShare: boolean }> {
  const share = (value: number) => ({ value, isShare: true });
  const count = (value: number | null) => ({ value, isShare: false });
  return {
    views: count(summary.views), of_visible: share(summary.coverage.of_visible), of_asked: share(summary.coverage.of_asked),
    of_coverable: share(summary.coverage.of_coverable), A: share(summary.grades.A ?? 0), B: share(summary.grades.B ?? 0),
    C: share(summary.grades.C ?? 0), D: share(summary.grades.D ?? 0), cycle: count(summary.cycle_secs), setups: count(summary.setups),
  };
}

function FigureTable({ sides }: { sides: [Side, Side] }) {
  const [one, two] = sides.map(({ job }) => figuresOf(job.summary!)) as [ReturnType<typeof figuresOf>, ReturnType<typeof figuresOf>];
  const show = (value: number | null, isShare: boolean, name: string): string =>
    (value === null ? text.none : isShare ? percent(value, 2) : name === "cycle" ? `${value.toFixed(1)} s` : String(value));
  return (
    <table>
      <thead><tr><th scope="col">{words.figure}</th><th scope="col">{words.first}</th><th scope="col">{words.second}</th><th scope="col">{words.difference}</th></tr></thead>
      <tbody>{Object.entries(one).map(([name, { value, isShare }]) => {
        const other = two[name]!.value;
        const difference = value === null || other === null ? null : other - value;
        return (
          <tr key={name}><th scope="row">{words.figures[name]}</th><td class="number">{show(value, isShare, name)}</td><td class="number">{show(other, isShare, name)}</td>
            <td class="number">{difference === null ? text.none : `${difference > 0 ? "+" : ""}${show(difference, isShare, name)}`}</td></tr>
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
    <table><tbody>{names.map((name) => <tr key={name}><th scope="row"><code>{name}</code></th><td><code>{show(one[name])}</code></td><td><code>{show(two[name])}</code></td></tr>)}</tbody></table>
  );
}

function Pair({ sides }: { sides: [Side, Side] }) {
  const stages = useRef<(Stage | null)[]>([null, null]);
  const couple = (at: number) => (stage: Stage | null): void => {
    stages.current[at] = stage;
    if (stages.current[0] && stages.current[1]) Stage.couple(stages.current[0], stages.current[1]);
  };
  const { x, lines } = useMemo(() => {
    const longest = Math.max(...sides.map(({ plan }) => plan.coverage.curve.length));
    const at = Array.from({ length: longest + 1 }, (_, i) => i);
    return { x: at, lines: sides.map(({ plan }, i) => ({ label: i ? words.second : words.first, values: at.map((n) => (n === 0 ? 0 : plan.coverage.curve[n - 1] ?? null)) })) };
  }, [sides]);
  return (
    <>
      <div class="pair">{sides.map((side, i) => (
        <div key={side.job.id} class="view3d">
          <p><a href={hrefOf(["jobs", side.job.id])}>{i ? words.second : words.first}: {partName(side.job)}</a> <StateMark job={side.job} /> <span class="soft">{facts(side.job)}</span></p>
          <PartView side={side} name={`compare-${i + 1}`} onStage={couple(i)} />
        </div>
      ))}</div>
      <p class="soft">{words.coupled}</p>
      <div class="pair">
        <section><FigureTable sides={sides} /></section>
        <section>
          <Chart title={text.plan.curve} x={x} lines={lines} xLabel={text.plan.views} yLabel={text.jobs.asked} percent yRange={[0, 1]} points />
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
  const { value, error } = useLoaded(async () => (first && second ? Promise.all([sideOf(first), sideOf(second)]) : null), [first, second]);
  const choices = jobIds.value.map((id) => jobSignal(id)!.value).filter((job) => job.state === "succeeded")
    .map((job): [string, string] => [job.id, `${partName(job)} · ${facts(job)}`]);
  const pick = (label: string, chosen: string, onChange: (id: string) => void) => (
    <Select label={label} value={chosen} onChange={onChange} options={[["", words.pick], ...choices]} />
  );
  return (
    <section class="compare" aria-labelledby="compare-title">
      <div class="title">
        <h1 id="compare-title">{words.title}</h1>
        {pick(words.first, first, (id) => goTo(pair(id, second)))}{pick(words.second, second, (id) => goTo(pair(first, id)))}
        <Button onClick={() => goTo(pair(second, first))}>{words.swap}</Button>
      </div>
      {error && <p class="problem" role="alert">{error}</p>}
      {value && <Pair key={`${first}${second}`} sides={value} />}
    </section>
  );
}

// Scans of a job: files are chosen and uploaded, listed, deleted; and inspections of them are started.
import { useSignal, type Signal } from "@preact/signals";
import { useState } from "preact/hooks";
import { apiPath, ask, askPages, post, remove, uploadScan, type InspectionJob, type Job, type Plan, type Run, type Scan } from "./api";
import { InspectionTable } from "./inspections";
import { RESCAN_OF } from "./joblist";
import { fileSize, hrefOf, percent, when, zoned } from "./settings";
import { text } from "./text";
import { Button, ConfirmButton, Cut, goToMade, NumberInput, Pending, Select, useLoaded, useNewest } from "./widgets";

const words = text.inspections;
const UNITS = ["mm", "cm", "m", "inch"];

interface Entry { file: File; view: string; share: number; problem: string }

const all = async <T,>(path: string): Promise<T[]> => (await askPages<T>(path)).items;

export function ScansView({ job }: { job: Job }) {
  const { value: plan } = useLoaded(() => ask<Plan>(`/jobs/${job.id}/plan`), [job.id]);
  const { value: scans, error, reload } = useLoaded(() => all<Scan>(`/jobs/${job.id}/scans`), [job.id]);
  const { value: inspections, error: problem, reload: reloadInspections, more } = useNewest<InspectionJob>(`/inspections?job_id=${job.id}`);
  const left = useSignal(new Set<string>());
  const views = plan?.viewpoints.filter(({ rejected }) => !rejected).map(({ id }) => id) ?? [];
  const before = job.labels[RESCAN_OF];
  if (error || problem || !scans || !inspections) return <Pending error={error || problem} />;
  return (
    <div class="results scans">
      <section>
        <h2>{words.uploadTitle}</h2>
        {before && <p class="soft">{words.isRescan} <a href={hrefOf(["inspections", before])}>{words.toBefore}</a></p>}
        <Upload job={job} views={views} onDone={reload} />
        <h2>{words.scanTitle(scans.length)}</h2>
        {scans.length === 0 ? <p class="soft">{words.noScans}</p> : <ScanTable scans={scans} left={left} reload={reload} />}
      </section>
      <section>
        <h2>{words.inspect}</h2>
        <Order job={job} plan={plan} scans={scans} left={left.value} />
        <h2>{words.title}</h2>
        {inspections.items.length === 0 ? <p class="soft">{words.noneOfJob}</p> : <InspectionTable items={inspections.items} reload={reloadInspections} />}
        <Cut page={inspections} onMore={more} />
      </section>
    </div>
  );
}

/** Files on their way to the server: dropped or chosen, several at once. */
function Upload({ job, views, onDone }: { job: Job; views: number[]; onDone: () => void }) {
  const entries = useSignal<Entry[]>([]);
  const [isOver, setOver] = useState(false);
  const [unit, setUnit] = useState("");
  const [frame, setFrame] = useState("");
  const replace = (file: File, change: Partial<Entry> | null): void => {
    entries.value = entries.peek().flatMap((other) => (other.file !== file ? [other] : change ? [{ ...other, ...change }] : []));
  };
  const take = (files: Iterable<File>): void => {
    const fresh = [...files].filter((file) => !entries.peek().some((other) => other.file.name === file.name && other.file.size === file.size));
    entries.value = [...entries.peek(), ...fresh.map((file): Entry => ({ file, view: "", share: 0, problem: "" }))];
  };
  const send = async (): Promise<void> => {
    for (const { file } of entries.peek()) {
      // As it stands now: one that waits may be removed, or given another view.
      const view = entries.peek().find((other) => other.file === file)?.view;
      if (view === undefined) continue;
      replace(file, { share: 0.001, problem: "" });
      try {
        await uploadScan(job.id, file, { view, unit, frame }, (share) => replace(file, { share: Math.max(0.001, share) }));
        replace(file, null);
      } catch (error) {
        replace(file, { share: 0, problem: (error as Error).message });
      }
    }
    onDone();
  };
  const choices: [string, string][] = [["", words.viewByName], ...views.map((id): [string, string] => [String(id), text.plan.view(id)])];
  return (
    <div class={`drop ${isOver ? "over" : ""}`} onDragOver={(event) => { event.preventDefault(); setOver(true); }} onDragLeave={() => setOver(false)}
      onDrop={(event) => { event.preventDefault(); event.stopPropagation(); setOver(false); take(event.dataTransfer?.files ?? []); }}>
      <label class="file"><span>{words.drop}</span>
        <input type="file" name="scans" multiple accept=".ply,.pcd,.e57,.xyz,.txt,.asc,.stl" onChange={(event) => { take(event.currentTarget.files ?? []); event.currentTarget.value = ""; }} />
      </label>
      <p class="soft">{words.dropHint}</p>
      {entries.value.length > 0 && (
        <>
          <ul>
            {entries.value.map(({ file, view, share, problem }) => (
              <li key={file.name + file.size} class="entry">
                <strong>{file.name}</strong> <span class="soft">{fileSize(file.size)}</span>
                {share > 0 ? <progress max={1} value={share} aria-label={text.create.uploading(file.name)} aria-valuetext={percent(share, 0)} />
                  : <><Select label={words.viewOf(file.name)} hideLabel value={view} options={choices} onChange={(value) => replace(file, { view: value })} />
                    <Button aria-label={text.create.drop1(file.name)} onClick={() => replace(file, null)}>×</Button></>}
                {problem && <p class="problem">{problem}</p>}
              </li>
            ))}
          </ul>
          <div class="grid">
            <Select label={words.unitOf} name="scan-unit" value={unit} onChange={setUnit} options={[["", words.findOut], ...UNITS.map((name): [string, string] => [name, name])]} />
            <Select label={words.frameOf} name="scan-frame" value={frame} onChange={setFrame} options={[["", words.findOut], ...Object.entries(words.frames)]} />
          </div>
          <p class="actions"><Button kind="primary" class="send" onClick={send}>{words.send(entries.value.length)}</Button></p>
        </>
      )}
    </div>
  );
}

function ScanTable({ scans, left, reload }: { scans: Scan[]; left: Signal<Set<string>>; reload: () => void }) {
  const use = (id: string, isUsed: boolean): void => {
    const next = new Set(left.value);
    if (isUsed) next.delete(id); else next.add(id);
    left.value = next;
  };
  const name = (scan: Scan): string => scan.name ?? scan.id.slice(0, 8);
  return (
    <div class="scroll" tabIndex={0} role="group" aria-label={words.scanTitle(scans.length)}>
      <table id="scans">
        <thead><tr><th scope="col"><span class="hidden">{words.use}</span></th>{[words.file, words.view, words.unit, words.frame, text.results.size, zoned(words.uploaded)].map((head) => <th key={head} scope="col">{head}</th>)}
          <th scope="col"><span class="hidden">{text.jobs.remove}</span></th></tr></thead>
        <tbody>{scans.map((scan) => (
          <tr key={scan.id}>
            <td><input type="checkbox" aria-label={words.useOf(name(scan))} checked={!left.value.has(scan.id)} onChange={(event) => use(scan.id, event.currentTarget.checked)} /></td>
            <th scope="row" class="name"><a href={`${apiPath}/scans/${scan.id}/file`} download>{name(scan)}</a></th>
            <td>{scan.view ?? words.byName}</td><td>{scan.unit ?? words.auto}</td><td>{scan.frame ? words.frames[scan.frame] ?? scan.frame : words.auto}</td>
            <td>{fileSize(scan.size_bytes)}</td><td class="time">{when(scan.created_at)}</td>
            <td><ConfirmButton label={text.jobs.remove} aria-label={`${text.jobs.remove} ${name(scan)}`} sure={text.sure(name(scan))} onConfirm={() => remove(`/scans/${scan.id}`).then(reload)} /></td>
          </tr>
        ))}</tbody>
      </table>
    </div>
  );
}

interface Interests { regions?: { interest?: { name?: string }[]; features?: { name?: string }[] } }

/** What is compared, how, and the start. */
function Order({ job, plan, scans, left }: { job: Job; plan: Plan | null; scans: Scan[]; left: Set<string> }) {
  const { value: runs } = useLoaded(() => all<Run>(`/runs?job=${job.id}`), [job.id]);
  const [method, setMethod] = useState("best_fit");
  const [region, setRegion] = useState("");
  const [tolerance, setTolerance] = useState<number>();
  const [run, setRun] = useState("");
  const regions = (plan?.params as Interests | undefined)?.regions;
  const names = [...regions?.interest ?? [], ...regions?.features ?? []].flatMap(({ name }) => (name ? [name] : []));
  const used = scans.filter(({ id }) => !left.has(id));
  const start = (): Promise<void> => goToMade(async () => {
    const params = { align: { method, ...(method === "best_fit_on" && { region: region || names[0] }) }, ...(tolerance !== undefined && { compare: { tolerance_mm: tolerance } }) };
    const request = { params, ...(left.size > 0 && { scans: used.map(({ id }) => id) }), ...(run && { run_id: run }) };
    const made = await post<InspectionJob>(`/jobs/${job.id}/inspections`, request);
    return hrefOf(["inspections", made.id]);
  });
  const methods = Object.entries(words.methods).filter(([name]) => name !== "best_fit_on" || names.length > 0);
  const ended = runs?.filter(({ state }) => ["done", "stopped", "failed"].includes(state)) ?? [];
  return (
    <>
      <p class="soft">{words.inspectHint}</p>
      <div class="grid">
        <Select label={words.method} name="method" value={method} onChange={setMethod} options={methods} />
        {method === "best_fit_on" && <Select label={words.region} value={region || names[0]!} onChange={setRegion} options={names.map((name) => [name, name])} />}
        <label><span>{words.measuredWithin}</span><NumberInput name="tolerance" min={0.001} placeholder={text.create.default} value={tolerance} onNumber={setTolerance} /></label>
        {ended.length > 0 && <Select label={words.poses} value={run} onChange={setRun} options={[["", words.asPlanned], ...ended.map(({ id, created_at: at }): [string, string] => [id, words.ofRun(when(at))])]} />}
      </div>
      <p class="actions"><Button kind="primary" class="inspect" disabled={used.length === 0} onClick={start}>{words.inspectScans(used.length)}</Button></p>
    </>
  );
}

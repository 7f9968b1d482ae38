// The list of jobs: live rows with picture, verdict and figures, filters that the address holds, and what can be done with each.
import { useSignal } from "@preact/signals";
import { useEffect, useMemo, useRef, useState } from "preact/hooks";
import { ask, idempotencyKey, post, put, remove, type Job, type Mesh, type Summary } from "./api";
import {
  cellName, ENDED, filterJobs, findJobs, findMore, jobIds, jobSignal, keepJob, listed, listMore, listProblem, partName, readJob, readList, refresh, retries,
  scannerName, secondsLeft, stream, forgetJob,
} from "./jobs";
import { hrefOf, percent, place, seconds, setQuery, when, withoutOptions, goTo, zone } from "./settings";
import { text } from "./text";
import { Button, ConfirmButton, Dialog, goToMade, guarded, message, Pending, Problem, Select } from "./widgets";
import { dropped } from "./dropped";

/** Label under which a job of further views names the inspection that it follows. */
export const RESCAN_OF = "rescan_of";

/** Facts of a job beside its name. */
export function facts(job: Job): string {
  const cell = cellName(job);
  const spent = Object.values(job.timings).reduce((sum, secs) => sum + secs, 0);
  return [
    cell === "none" ? `${text.jobs.viewpointsAlone}, ${scannerName(job)}` : text.jobs.cell(cell),
    job.part_number && text.jobs.number(job.part_number),
    job.serial && text.jobs.serial(job.serial),
    job.submitted_by && text.jobs.by(job.submitted_by),
    spent > 0 && ENDED.includes(job.state) && text.jobs.spent(seconds(spent)),
  ].filter(Boolean).join(" · ");
}

/** Link to a job by the name of its part. */
export function JobLink({ id, tab = [] }: { id: string; tab?: string[] }) {
  // Read once it is kept; its name stays once it was dropped.
  void jobIds.value;
  const seen = jobSignal(id)?.value;
  const last = useRef<Job | null>(null);
  if (seen) last.current = seen;
  const job = last.current?.id === id ? last.current : undefined;
  useEffect(() => { if (!jobSignal(id)) void readJob(id).catch(() => {}); }, [id]);
  return <a href={hrefOf(["jobs", id, ...tab])}>{job ? partName(job) : id.slice(0, 8)}</a>;
}

export function StateMark({ job }: { job: Job }) {
  const level = job.summary?.level;
  const name = text.states[job.state] ?? job.state;
  return <span class={`state ${level ?? job.state}`}>{job.state === "succeeded" && level ? `${name}: ${text.levels[level] ?? level}` : name}</span>;
}

/** Time for which a row rests in view before its picture is drawn. */
const REST_MS = 150;

function Thumbnail({ job }: { job: Job }) {
  const canvas = useRef<HTMLCanvasElement>(null);
  useEffect(() => {
    const element = canvas.current!;
    let waiting: ReturnType<typeof setTimeout> | undefined;
    // Rows that only pass by while the list is scrolled are not drawn.
    const watching = new IntersectionObserver((entries) => {
      clearTimeout(waiting);
      if (!entries.at(-1)!.isIntersecting) return;
      waiting = setTimeout(() => {
        watching.disconnect();
        void import("./thumbnail").then((room) => room.drawThumbnail(element, job.mesh_id, job.state === "succeeded" ? job.id : null), () => {});
      }, REST_MS);
    });
    watching.observe(element);
    return () => { clearTimeout(waiting); watching.disconnect(); };
  }, [job.id, job.state === "succeeded", retries.value]);
  return <canvas ref={canvas} class="thumb" width={144} height={108} role="img" aria-label={text.jobs.thumbnail(partName(job))} />;
}

/** Stage, fraction and time left while it is planned, or its place in the queue. */
export function Progress({ job }: { job: Job }) {
  const [, tick] = useState(0);
  const isActive = job.state === "running" || job.state === "cancelling";
  useEffect(() => {
    if (!isActive) return undefined;
    const timer = setInterval(() => tick((n) => n + 1), 1000);
    return () => clearInterval(timer);
  }, [isActive]);
  if (job.state === "queued") {
    return job.queue_position ? <p class="soft">{text.jobs.place(job.queue_position)}</p> : null;
  }
  if (!isActive) return null;
  const left = secondsLeft(job);
  return (
    <div class="progress">
      <progress max={1} value={job.fraction} aria-label={text.jobs.progress(partName(job))} />
      <span class="soft">
        {[job.stage && (text.stages[job.stage] ?? job.stage), percent(job.fraction, 0), left !== null && text.jobs.left(seconds(left))]
          .filter(Boolean).join(" · ")}
      </span>
    </div>
  );
}

export function JobProblem({ job }: { job: Job }) {
  const problem = job.problem;
  if (!problem) return null;
  return (
    <p class="problem">
      {/* Where fields are at fault, the detail is what is said of them. */}
      {problem.errors.length > 0 ? problem.title : `${problem.title}: ${problem.detail}`}
      {problem.errors.map((field) => <span key={field.pointer}><br /><code>{field.pointer}</code> {field.detail}</span>)}
      {" "}<a href={`problems/${problem.code}`}>{text.jobs.whatToDo}</a>
    </p>
  );
}

/** Parameters with some of them, by path, set. */
export function withSet(given: Record<string, unknown>, set: Record<string, unknown>): Record<string, unknown> {
  const params = structuredClone(given);
  for (const [path, value] of Object.entries(set)) {
    const names = path.split(".");
    const last = names.pop()!;
    // Only what the parameters themselves hold: a path of a link must not lead to what all objects share.
    const owner = names.reduce((at, name) => {
      const own = Object.hasOwn(at, name) ? at[name] : null;
      return (at[name] = own ?? {}) as Record<string, unknown>;
    }, params);
    owner[last] = value;
  }
  return params;
}

/** Labels that a copy of a job takes over: it is planned anew, and follows no inspection. */
export const copied = ({ [RESCAN_OF]: _, ...labels }: Record<string, string>): Record<string, string> => labels;

/** Starts the same job once more, from what the server has of it, with some parameters changed or with another mesh, and goes there. */
export const planAgain = (id: string, set: Record<string, unknown> = {}, uploaded?: () => Promise<Mesh>): Promise<void> => goToMade(async () => {
  const job = await ask<Job>(`/jobs/${id}`);
  const params = withSet((job.params ?? {}) as Record<string, unknown>, set);
  const request: Record<string, unknown> = { mesh_id: (await uploaded?.())?.id ?? job.mesh_id, cell: job.cell, params, labels: copied(job.labels), priority: job.priority };
  if (cellName(job) === "none") request.scanner = job.scanner;
  if (job.part_number) request.part_number = job.part_number;
  if (job.serial) request.serial = job.serial;
  const made = await post<Job>("/jobs", request, idempotencyKey());
  keepJob(made);
  return hrefOf(["jobs", made.id]);
});

const cancelJob = (id: string): Promise<unknown> => post<Job>(`/jobs/${id}/cancel`).then(() => readJob(id));

export function JobActions({ job, onLabels }: { job: Job; onLabels?: () => void }) {
  return (
    <span class="actions">
      {(job.state === "queued" || job.state === "running") && <Button onClick={() => cancelJob(job.id)}>{text.jobs.cancel}</Button>}
      {(job.state === "failed" || job.state === "cancelled") && (
        <Button onClick={() => planAgain(job.id)}>{text.jobs.retry}</Button>
      )}
      <a class="button" href={hrefOf(["new"], { from: job.id })}>{text.jobs.clone}</a>
      {onLabels && <Button onClick={onLabels}>{text.jobs.labels}</Button>}
      {ENDED.includes(job.state) && <ConfirmButton label={text.jobs.remove} sure={text.sure(text.jobs.results([partName(job)]))}
        onConfirm={async () => {
          await remove(`/jobs/${job.id}`);
          if (place.peek().path[1] === job.id) goTo(hrefOf(["jobs"]));
          forgetJob(job.id);
        }} />}
    </span>
  );
}

/** Labels as they are written, one `key=value` each; throws at one that is no such pair. */
export function labelsOf(written: string[]): Record<string, string> {
  return Object.fromEntries(written.filter((one) => one.trim()).map((one) => {
    const [, key, value] = /^\s*([^=]*?)\s*=\s*(.*?)\s*$/s.exec(one) ?? [];
    if (!key) throw new Error(text.jobs.noLabel(one.trim()));
    return [key, value!];
  }));
}

export function LabelsDialog({ job, onClose }: { job: Job; onClose: () => void }) {
  const lines = useSignal(Object.entries(job.labels).map(([name, value]) => `${name}=${value}`).join("\n"));
  const save = async (): Promise<void> => {
    await put(`/jobs/${job.id}/labels`, { labels: labelsOf(lines.value.split("\n")) });
    await readJob(job.id);
    onClose();
  };
  return (
    <Dialog title={text.jobs.labels} onClose={onClose}>
      <label><span>{text.jobs.labelsHint}</span>
        <textarea rows={5} value={lines.value} onInput={(event) => { lines.value = event.currentTarget.value; }} />
      </label>
      <p class="actions"><Button kind="primary" onClick={save}>{text.jobs.save}</Button><Button onClick={onClose}>{text.jobs.cancel}</Button></p>
    </Dialog>
  );
}

/** True where the program that the robot runs takes another time than the motion as planned, which its controller cannot carry out. */
export const hasOwnCycle = ({ program_cycle: program, cycle_secs: planned }: Summary): boolean =>
  Boolean(program && planned !== null && seconds(program.cycle_secs) !== seconds(planned));

function Figures({ job }: { job: Job }) {
  const summary = job.summary;
  if (!summary) return null;
  const figure = (value: string, name: string) => <div class="figure"><strong>{value}</strong><span>{name}</span></div>;
  return (
    <div class="figures">
      {figure(String(summary.views), summary.views === 1 ? text.jobs.view : text.plan.views)}
      {figure(percent(summary.coverage.of_visible), summary.of_open ? text.jobs.visibleOpen : text.jobs.coverage)}
      {figure(percent(summary.coverage.of_asked), summary.of_open ? text.jobs.open : text.jobs.asked)}
      {hasOwnCycle(summary) ? figure(seconds(summary.program_cycle!.cycle_secs), text.jobs.cycleProgram)
        : summary.cycle_secs !== null && figure(seconds(summary.cycle_secs), text.jobs.cycle)}
    </div>
  );
}

function Row({ id, fits, chosen, onChoose }: {
  id: string; fits: (job: Job) => boolean; chosen: boolean; onChoose: (id: string, isChosen: boolean) => void;
}) {
  const labels = useSignal(false);
  const job = jobSignal(id)?.value;
  if (!job || !fits(job)) return null;
  const name = partName(job);
  return (
    <li class="job" id={`job-${id}`} data-state={job.state} data-level={job.summary?.level ?? ""}>
      <input type="checkbox" aria-label={text.jobs.choose(name)} checked={chosen} onChange={(event) => onChoose(id, event.currentTarget.checked)} />
      <a class="picture" href={hrefOf(["jobs", id])} tabIndex={-1} aria-hidden="true"><Thumbnail job={job} /></a>
      <div class="about">
        <p class="head"><a class="part" href={hrefOf(["jobs", id])}>{name}</a><StateMark job={job} />
          {Object.entries(job.labels).map(([key, value]) => (
            <button key={key} type="button" class="chip" onClick={() => setQuery({ q: `${key}=${value}` })}>{key}: {value}</button>
          ))}
        </p>
        <p class="soft">{facts(job)} · <time dateTime={job.created_at}>{when(job.created_at)}</time></p>
        {job.summary && <p class="verdict">{job.summary.title}</p>}
        {job.summary?.action && <p class="soft">{text.job.next}: {withoutOptions(job.summary.action.text)}</p>}
        <Progress job={job} />
        <JobProblem job={job} />
      </div>
      <Figures job={job} />
      <JobActions job={job} onLabels={() => { labels.value = true; }} />
      {labels.value && <LabelsDialog job={job} onClose={() => { labels.value = false; }} />}
    </li>
  );
}

/** True if a job has the words: its name, numbers, id, or a label as `key=value`. */
function hasWords(job: Job, words: string): boolean {
  const labels = Object.entries(job.labels).map(([name, value]) => `${name}=${value}`);
  const all = [partName(job), job.part_number, job.serial, job.id, cellName(job), job.submitted_by, ...labels].join("\n").toLowerCase();
  return words.toLowerCase().split(/\s+/).every((word) => all.includes(word));
}

const LABEL = /^[^=\s]+=[^=]+$/;
/** Time without a key pressed after which the server is asked for the words. */
const TYPED_MS = 300;

/** Asks the server for what fits: it filters by state and label, and finds a number; names are those of the jobs that are read. */
function useServerFilter(state: string, words: string): void {
  const label = LABEL.test(words) ? words : "";
  const number = label ? "" : words.trim();
  useEffect(() => {
    const timer = setTimeout(() => void guarded(async () => {
      await filterJobs({ ...(state && { state }), ...(label && { label }) });
      await findJobs(number ? ["part_number", "serial"].map((name) => `${name}=${encodeURIComponent(number)}`) : []);
    }), words ? TYPED_MS : 0);
    return () => clearTimeout(timer);
  }, [state, words]);
}

/** Deletes jobs; says which the server kept, of which the list then has the present state. */
async function deleteJobs(ids: string[]): Promise<void> {
  const { held, not_ended: going } = await post<{ held: number; not_ended: number }>("/jobs/delete", { ids });
  if (held + going === 0) return ids.forEach(forgetJob);
  await Promise.all(ids.map(refresh));
  message.value = text.jobs.kept(held, going);
}

/** Names of jobs; those that are not the only ones of their name with part number and time. */
function namesOf(jobs: Job[]): string[] {
  const names = jobs.map(partName);
  return jobs.map((job, i) => (names.indexOf(names[i]!) === names.lastIndexOf(names[i]!) ? names[i]!
    : text.jobs.nameWith(names[i]!, [job.part_number, when(job.created_at)].filter(Boolean).join(", "))));
}

function Chosen({ ids, onDone }: { ids: string[]; onDone: () => void }) {
  if (ids.length === 0) return <p class="soft">{text.jobs.compareHint} {text.times(zone)}</p>;
  return (
    <p class="actions">
      <span>{text.jobs.chosen(ids.length)}</span>
      {ids.length === 2 && <a class="button primary" href={hrefOf(["compare", ids[0]!, ids[1]!])}>{text.jobs.compare}</a>}
      <ConfirmButton label={text.jobs.remove} sure={text.sure(text.jobs.results(namesOf(ids.map((id) => jobSignal(id)!.value))))} onConfirm={() => deleteJobs(ids).then(onDone)} />
    </p>
  );
}

/** Files that are dropped anywhere on the list begin a new plan. */
function takeDrop(event: DragEvent): void {
  event.preventDefault();
  const files = [...(event.dataTransfer?.files ?? [])];
  if (files.length === 0) return;
  dropped.value = files;
  goTo(hrefOf(["new"]));
}

export function JobList() {
  const chosen = useSignal<string[]>([]);
  const { query } = place.value;
  const [state, words] = [query.get("state") ?? "", query.get("q") ?? ""];
  // Rows whose properties stay the same are not drawn anew when another row changes.
  const fits = useMemo(() => (job: Job): boolean => (!state || job.state === state) && (!words || hasWords(job, words)), [state, words]);
  const choose = useMemo(() => (id: string, isChosen: boolean): void => {
    chosen.value = isChosen ? [...chosen.peek(), id] : chosen.peek().filter((other) => other !== id);
  }, []);
  useServerFilter(state, words);
  const isLost = stream.connection.value === "lost";
  // The stream of events begins with the list; without it, the list is asked for what is wrong.
  useEffect(() => { if (listProblem.peek() || (isLost && !listed.peek())) void readList(); }, [isLost, retries.value]);
  const ids = jobIds.value;
  const [reached, problem] = [listed.value, listProblem.value];
  // Below what is listed, jobs may be missing; what was searched for is shown wherever it stands.
  const shown = ids.filter((id) => {
    const job = jobSignal(id)?.value;
    return job && fits(job) && (words !== "" || !reached?.token || id >= reached.last);
  });
  // Names are searched only in what is read; states, labels and numbers by the server.
  const isPart = words !== "" && !LABEL.test(words) && reached?.token;
  return (
    <section class="jobs" aria-labelledby="jobs-title" onDragOver={(event) => event.preventDefault()} onDrop={takeDrop}>
      <div class="title">
        <h1 id="jobs-title">{text.jobs.title}</h1>
        <Select label={text.jobs.state} value={state} onChange={(value) => setQuery({ state: value || undefined })}
          options={[["", text.jobs.all], ...Object.entries(text.states)]} />
        <label><span>{text.jobs.search}</span>
          <input type="search" value={words} placeholder={text.jobs.searchHint} onInput={(event) => setQuery({ q: event.currentTarget.value || undefined })} />
        </label>
        <a class="button primary" href={hrefOf(["new"])}>{text.nav.create}</a>
      </div>
      <Chosen ids={chosen.value.filter((id) => shown.includes(id))} onDone={() => { chosen.value = chosen.peek().filter(jobSignal); }} />
      {problem ? <Problem error={problem} /> : !reached && shown.length === 0 && <Pending />}
      {reached && ids.length === 0 && <p id="empty" class="empty">{text.jobs.empty}</p>}
      {reached && ids.length > 0 && shown.length === 0 && !isPart && <p class="empty">{text.jobs.noneFit}</p>}
      {isPart && <p class={shown.length ? "soft" : "empty"} role="status">{text.jobs.searched(ids.filter((id) => id >= reached.last).length)}</p>}
      <ul id="jobs">
        {shown.map((id) => (
          <Row key={id} id={id} fits={fits} chosen={chosen.value.includes(id)} onChoose={choose} />
        ))}
      </ul>
      <p id="listed" class="soft" role="status">{reached && !isPart && (reached.token ? text.cut(shown.length) : text.jobs.listed(shown.length, ids.length))}</p>
      {findMore.value && <Button onClick={findMore.value}>{text.jobs.olderFound}</Button>}
      {reached?.token && <button id="more" type="button" onClick={() => void guarded(listMore)}>{text.jobs.older}</button>}
    </section>
  );
}

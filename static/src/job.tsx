// One job: its head with verdict and actions, and its parts: plan, cell, results.
import { useComputed, useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { apiPath, askAhead, type Job, type Note, type Region } from "./api";
import { ENDED, jobIds, jobSignal, partName, readJob, retries, stream } from "./jobs";
import { facts, JobActions, LabelsDialog, planAgain, Progress, StateMark } from "./joblist";
import { area, goTo, hrefOf, limits, nonzero, percent, place, setQuery, unit, withoutOptions } from "./settings";
import { StartRun } from "./startrun";
import { text } from "./text";
import { Button, CopyLink, known, Lazy, Pending, Tabs } from "./widgets";

export function Remedy({ job, label, set }: { job: Job; label: string; set: Record<string, unknown> }) {
  const values = Object.entries(set).map(([name, value]) => `${name} = ${JSON.stringify(value)}`);
  if (values.length === 0) return null;
  return (
    <Button kind="primary" title={`${text.job.applied} ${values.join(", ")}`} onClick={() => planAgain(job.id, set)}>{label}</Button>
  );
}

export function Sentences({ job }: { job: Job }) {
  const summary = job.summary;
  if (!summary) return null;
  const sentences = [summary.verdict_text, summary.views_text, summary.coverage_text, summary.cycle_text && withoutOptions(summary.cycle_text)].filter((sentence) => sentence !== null);
  const program = summary.program_cycle;
  return (
    <>
      <ul class="summary" aria-label={text.job.summary}>{sentences.map((sentence) => <li key={sentence}>{sentence}</li>)}</ul>
      <UnitNote of={sentences} />
      {program?.command && <p class="actions"><Remedy job={job} label={text.job.asProgram} set={program.set} /></p>}
    </>
  );
}

/** Says in which unit sentences of the server are, where the page shows another and they name one. */
export function UnitNote({ of }: { of: (string | null | undefined)[] }) {
  const isNeeded = unit.value !== "mm" && of.some((sentence) => /\bmm/.test(sentence ?? ""));
  return isNeeded ? <p class="soft unit-note">{text.job.unitNote}</p> : null;
}

export function Warnings({ of: warnings }: { of: Note[] | undefined }) {
  if (!warnings?.length) return null;
  return (
    <section class="warnings" aria-label={text.job.warnings}>
      {warnings.map((warning) => (
        <p key={`${warning.pointer}${warning.code}`}><code>{warning.pointer}</code> {warning.detail}<br />→ {withoutOptions(warning.remedy)}</p>
      ))}
      <UnitNote of={warnings.flatMap(({ detail, remedy }) => [detail, remedy])} />
    </section>
  );
}

/** Share on samples that the views were not chosen on. */
const onOtherSamples = ({ independent_of_asked: share, independent_standard_error: error }: Region): string =>
  (typeof share === "number" && typeof error === "number" ? text.regionTable.withError(percent(share, 2), nonzero(100 * error, 2)) : text.none);

/** Verdict on a region: a target that is reached on the samples that views were chosen on alone is not told as met. */
function verdictOf(region: Region): string {
  const words = text.regionTable;
  if (region.met === true) return region.independently_met === false ? words.unconfirmed : words.met;
  return region.met === false ? words.unmet : text.none;
}

export function RegionTable({ regions }: { regions: Region[] }) {
  const words = text.regionTable;
  return (
    <table class="regions">
      <thead><tr>{[words.name, words.target, words.reached, words.verdict, words.others, words.why, words.kind, words.area, words.samples]
        .map((name) => <th key={name} scope="col">{name}</th>)}</tr></thead>
      <tbody>
        {regions.map((region) => (
          <tr key={region.name} class={region.met === false || region.independently_met === false ? "unmet" : ""}>
            <td>{region.name}</td>
            <td class="number">{region.target === undefined || region.target === null ? text.none : percent(region.target, 2)}</td>
            <td class="number">{percent(region.of_asked, 2, region.met === false ? region.target ?? 1 : 1)}</td>
            <td>{verdictOf(region)}</td><td class="number">{onOtherSamples(region)}</td><td class="why">{region.why_unmet ?? ""}</td>
            <td>{[region.kind, typeof region.tolerance_mm === "number" && limits(region.tolerance_mm)].filter(Boolean).join(", ")}</td>
            <td class="number">{area(region.asked_area_mm2)}</td><td class="number">{region.samples}</td>
          </tr>
        ))}
      </tbody>
    </table>
  );
}

function Head({ job, tab }: { job: Job; tab: string }) {
  const labels = useSignal(false);
  const action = job.summary?.action;
  const programs = job.results.filter((file) => /^program(-\d)?\.json$/.test(file.name)).length;
  return (
    <div class="jobhead">
      <div class="title">
        <h1 title={partName(job)}>{partName(job)}</h1><StateMark job={job} />
        <span class="actions">
          {programs > 0 && <StartRun kind="primary" job={job.id} setups={programs} />}
          {job.results.some((file) => file.name === "report.html") && (
            <a class="button" href={`${apiPath}/jobs/${job.id}/report`} target="_blank" rel="noopener">{text.job.report}</a>
          )}
          <CopyLink />
          <JobActions job={job} onLabels={() => { labels.value = true; }} />
        </span>
      </div>
      <p class="soft facts">{facts(job)}</p>
      {action && <p class="next"><span>{text.job.next}: {withoutOptions(action.text)}</span><Remedy job={job} label={text.job.apply} set={action.set} /></p>}
      <Progress job={job} />
      {/* The summary of a plan has all of them; a doubtful unit is told wherever one looks. */}
      {tab !== "results" && <Warnings of={job.warnings?.filter(({ code }) => job.state !== "succeeded" || /^part_[sl]/.test(code))} />}
      {labels.value && <LabelsDialog job={job} onClose={() => { labels.value = false; }} />}
      <div class="headrow">
        <Tabs label={text.job.label} names={text.job.tabs} chosen={tab} onChoose={(name) => goTo(hrefOf(["jobs", job.id, name], Object.fromEntries(place.value.query)))} />
        {job.summary && <p class="verdict" title={job.summary.title}>{job.summary.title}</p>}
      </div>
    </div>
  );
}

/** What is shown of a job, by tab; of one that failed, why. */
const VIEWS: Record<string, () => Promise<(props: { job: Job; query: URLSearchParams; setQuery: typeof setQuery }) => unknown>> = {
  plan: async () => (await import("./plan")).PlanView,
  cell: async () => (await import("./cell")).CellView,
  inspection: async () => (await import("./scans")).ScansView,
  results: async () => (await import("./results")).Results,
  failure: async () => (await import("./failure")).Failure,
};

export function JobView({ id, tab: named }: { id: string; tab: string }) {
  const tab = known(text.job.tabs, named);
  const problem = useSignal("");
  const read = useSignal(jobSignal(id)?.peek());
  const isLost = stream.connection.value === "lost";
  useEffect(() => {
    if (isLost && read.peek()) return undefined;
    let isCurrent = true;
    problem.value = "";
    const isPlan = tab === "plan";
    if (isPlan) void import("./plan").catch(() => {});
    readJob(id).then((job) => {
      if (isPlan && job.state === "succeeded" && !read.peek()) [`/jobs/${id}/plan`, `/meshes/${job.mesh_id}/preview.glb`, `/jobs/${id}/coverage.bin`, `/jobs/${id}/missed`].forEach(askAhead);
      [read.value, problem.value] = [job, ""];
    }, (error) => { if (isCurrent) problem.value = error.message; });
    // An earlier attempt may fail after the last one has its answer.
    return () => { isCurrent = false; };
  }, [id, isLost, retries.value]);
  // A job that is deleted elsewhere leaves the list of those that are known, not its signal.
  const isKnown = useComputed(() => jobIds.value.includes(id));
  // `read` only says that the job is there; its state comes from the live signal.
  const job = read.value && isKnown.value ? jobSignal(id)?.value : undefined;
  if (problem.value || !job) return <Pending error={problem.value || (read.value && text.notFound)} />;
  const { state } = job;
  // An event tells the state before the job with its results, or its problem, is read.
  const isReady = state === "succeeded" && job.ended_at && job.params;
  const hasFailed = state === "failed" && (job.ended_at || job.problem);
  const shown = tab === "results" ? tab : isReady ? tab : hasFailed ? "failure" : "";
  return (
    <div class="jobview">
      <Head job={job} tab={tab} />
      <div role="tabpanel" aria-label={text.job.tabs[tab as "plan"]} class="panel">
        {shown ? <Lazy key={shown} load={VIEWS[shown]!} props={{ job, query: place.value.query, setQuery }} />
          : <p class="empty" role="status">{state === "cancelled" ? text.job.wasCancelled : ENDED.includes(state) ? text.loading : text.job.pending(text.states[state] ?? state)}</p>}
      </div>
    </div>
  );
}

// The page of a job that failed: what is wrong, at which field, and what to do next, with the fields at fault a click away.
import { apiPath, ask, request, uploadMesh, type Job, type Mesh } from "./api";
import { UnitNote } from "./job";
import { planAgain } from "./joblist";
import { apiDocument, changesOf, resolved, type Api, type Schema } from "./schema";
import { hrefOf } from "./settings";
import { text } from "./text";
import { Button, useLoaded } from "./widgets";

const words = text.failure;

/** Parameters by path, `group.key` or `key`, with their schemas. */
function parametersOf(api: Api): Map<string, Schema> {
  const found = new Map<string, Schema>();
  for (const [group, schema] of Object.entries(resolved(api, { $ref: "PlanParams" }).properties ?? {})) {
    const inner = resolved(api, schema);
    if (inner.properties) Object.entries(inner.properties).forEach(([key, field]) => found.set(`${group}.${key}`, resolved(api, field)));
    else found.set(group, inner);
  }
  return found;
}

/** Field of the form that a pointer into the request leads to. */
function fieldOf(pointer: string, parameters: Map<string, Schema>): string | null {
  const [first, group, key] = pointer.split("/").slice(1);
  if (first === "cell" || first === "scanner") return first;
  if (first !== "params" || !group) return null;
  return [`${group}.${key}`, group].find((name) => parameters.has(name)) ?? null;
}

interface Fix { field: string; value?: unknown }

/** Value of a parameter that a sentence states, where it states one and not several to choose from. */
function stated(sentence: string, field: string, schema: Schema): unknown {
  const [, given, after] = new RegExp(`\\b${field.replace(".", "\\.")} ?= ?([\\w.-]*\\w)( or )?`).exec(sentence) ?? [];
  if (given === undefined || after) return undefined;
  if (schema.enum) return schema.enum.includes(given) ? given : undefined;
  return Number.isFinite(Number(given)) ? Number(given) : undefined;
}

/** Parameters that sentences name, beside those that errors already lead to. */
function fixesIn(sentences: string, parameters: Map<string, Schema>, known: string[]): Fix[] {
  return [...parameters].filter(([field]) => !known.includes(field))
    // A word such as `setups` is a parameter only where a value follows it.
    .filter(([field]) => new RegExp(`(^|[^\\w.])${field.replace(".", "\\.")}${field.includes(".") ? "\\b(?!\\.)" : " ?= ?"}`).test(sentences))
    .map(([field, schema]) => ({ field, value: stated(sentences, field, schema) }));
}

function FixLink({ job, fix: { field, value }, kind = "" }: { job: Job; fix: Fix; kind?: string }) {
  const set = value === undefined ? undefined : JSON.stringify({ [field]: value });
  return (
    <a class={`button ${kind}`} href={hrefOf(["new"], { from: job.id, at: field, set })}>
      {value === undefined ? words.change(field) : words.set(field, JSON.stringify(value))}
    </a>
  );
}

/** Units of a sentence such as "it would fit if the file is in cm (4.0 × 3.0 × 2.0 mm), or inches (10.2 × 7.6 × 5.1 mm)". */
const SUITS = /(?:file is in|, or) (mm|cm|m|inch)(?:es)? \(/g;

/** Uploads the same file read in another unit, and plans it. */
const planInUnit = (job: Job, unit: string): Promise<void> => planAgain(job.id, {}, async () => {
  const mesh = await ask<Mesh>(`/meshes/${job.mesh_id}`);
  const bytes = await (await request(`/meshes/${job.mesh_id}/file`)).blob();
  return uploadMesh(new File([bytes], mesh.name ?? job.mesh_id), unit, () => {});
});

/** Problems that another attempt at the same job may not have. */
const PASSING = ["job_panicked", "job_attempts_exhausted", "internal", "job_too_long"];

export function Failure({ job }: { job: Job }) {
  const { value: api } = useLoaded(apiDocument, []);
  const problem = job.problem;
  const parameters = api ? parametersOf(api) : new Map<string, Schema>();
  const errors = (problem?.errors ?? []).map((error) => ({ ...error, field: fieldOf(error.pointer, parameters) }));
  const sentences = [problem?.detail, ...errors.map(({ detail }) => detail)].join("\n");
  const fixes = fixesIn(sentences, parameters, errors.flatMap(({ field }) => field ?? []));
  const units = new Set([...sentences.matchAll(SUITS)].map(([, unit]) => unit!));
  const hasReport = job.results.some((file) => file.name === "report.html");
  const changed = api ? Object.entries(changesOf(api, job.params ?? {})).filter(([name]) => !errors.some(({ field }) => field === name)) : [];
  const isPassing = PASSING.includes(problem?.code ?? "");
  return (
    <section class="failure" aria-labelledby="failure-title" data-code={problem?.code}>
      <h2 id="failure-title" class="bad">{problem?.title || text.states.failed}</h2>
      {problem && errors.length === 0 && <p class="detail">{problem.detail}</p>}
      {errors.length > 0 && (
        <table class="faults">
          <thead><tr><th scope="col">{words.field}</th><th scope="col">{words.fault}</th><th scope="col"><span class="hidden">{words.fix}</span></th></tr></thead>
          <tbody>{errors.map(({ pointer, detail, field }) => (
            <tr key={pointer + detail}><th scope="row"><code>{pointer}</code></th><td>{detail}</td>
              <td>{field && <FixLink job={job} fix={{ field, value: undefined }} kind="primary" />}</td></tr>
          ))}</tbody>
        </table>
      )}
      <UnitNote of={[sentences]} />
      <h3>{words.next}</h3>
      <p>{words.help[problem?.code ?? ""] ?? words.help.internal}</p>
      <p class="actions">
        {[...units].map((unit) => <Button key={unit} kind="primary" onClick={() => planInUnit(job, unit)}>{words.inUnit(unit)}</Button>)}
        {fixes.map((fix) => <FixLink key={fix.field} job={job} fix={fix} />)}
        {isPassing && <Button kind="primary" onClick={() => planAgain(job.id)}>{text.jobs.retry}</Button>}
        {hasReport && <a class="button" href={`${apiPath}/jobs/${job.id}/report`} target="_blank" rel="noopener">{words.report}</a>}
        {problem?.code === "file_damaged" || errors.some(({ pointer }) => pointer === "/mesh_id") ? <a class="button" href={hrefOf(["new"])}>{words.upload}</a> : null}
        {problem && <a class="button" href={`problems/${problem.code}`}>{text.jobs.whatToDo}</a>}
      </p>
      {changed.length > 0 && (
        <>
          <h3>{text.results.settings}</h3>
          <table><tbody>{changed.map(([name, value]) => (
            <tr key={name}><th scope="row"><code>{name}</code></th><td><code>{JSON.stringify(value).slice(0, 120)}</code></td>
              <td class="number"><a href={hrefOf(["new"], { from: job.id, at: name })}>{words.change(name)}</a></td></tr>
          ))}</tbody></table>
        </>
      )}
      {isPassing && <p class="soft">{words.number} <code>{job.id}</code></p>}
    </section>
  );
}

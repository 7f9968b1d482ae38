// Files of a job, its settings that differ from the defaults, and its regions.
import { apiPath, type Job } from "./api";
import { RegionTable, Sentences, Warnings } from "./job";
import { apiDocument, changesOf } from "./schema";
import { fileSize, seconds } from "./settings";
import { text } from "./text";
import { useLoaded } from "./widgets";

function nameOf(file: string): string {
  const own = file.replace(".foreign", "");
  const name = text.results.names[own] ?? own;
  return file.includes(".foreign") ? `${name}, ${text.results.foreign}` : name;
}

export function Results({ job }: { job: Job }) {
  const { value: api, error } = useLoaded(apiDocument, []);
  const changes = api && job.params ? Object.entries(changesOf(api, job.params)) : [];
  const path = (file: string): string => `${apiPath}/jobs/${job.id}/files/${file}`;
  return (
    <div class="results columns">
      <section>
        <h2>{text.job.summary}</h2><Sentences job={job} /><Warnings of={job.warnings} />
        <h2>{text.plan.time}</h2>
        <table><tbody>{Object.entries(job.timings).sort(([, a], [, b]) => b - a).map(([stage, secs]) => (
          <tr key={stage}><th scope="row">{text.stages[stage] ?? stage}</th><td class="number">{secs < 10 ? `${secs.toFixed(2)} s` : seconds(secs)}</td></tr>
        ))}</tbody></table>
      </section>
      <section>
        <h2>{text.results.title}</h2>
        <table>
          <thead><tr><th scope="col">{text.results.file}</th><th scope="col">{text.results.size}</th><th scope="col"><span class="hidden">{text.results.download}</span></th></tr></thead>
          <tbody>{job.results.map((file) => (
            <tr key={file.name}>
              <th scope="row">{nameOf(file.name)}</th><td class="number">{fileSize(file.size_bytes)}</td>
              <td>{file.name === "report.html" ? <a href={`${apiPath}/jobs/${job.id}/report`} target="_blank" rel="noopener">{text.results.open}</a>
                : <a href={path(file.name)} download aria-label={`${text.results.download} ${file.name}`}>{file.name}</a>}</td>
            </tr>
          ))}</tbody>
        </table>
        <h2>{text.results.settings}</h2>
        {!api ? <p class="soft" role="status">{error || text.loading}</p> : changes.length === 0 ? <p class="soft">{text.results.allDefault}</p> : (
          <table><tbody>{changes.map(([name, value]) => <tr key={name}><th scope="row"><code>{name}</code></th><td><code>{JSON.stringify(value)}</code></td></tr>)}</tbody></table>
        )}
        {Boolean(job.regions?.length) && <><h2>{text.results.regions}</h2><div class="scroll" tabIndex={0} role="group" aria-label={text.results.regions}><RegionTable regions={job.regions!} /></div></>}
      </section>
    </div>
  );
}

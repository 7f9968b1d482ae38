// Inspections: what was scanned against what was planned. Their list; and one with its verdict, map, deviation, alignment,
// what the scans teach, the views that are missing, and what further views brought.
import { useSignal } from "@preact/signals";
import { useEffect, useMemo, useState } from "preact/hooks";
import {
  apiPath,
  ask,
  askPages,
  post,
  remove,
  type Estimate,
  type Inspection,
  type InspectionJob,
  type Job,
  type Learned,
  type Loss,
  type Offer,
  type RateBin,
  type Statistics,
  type Vector,
} from "./api";
import { Chart } from "./chart";
import { faceMapOf, type MapKind } from "./facemap";
import { JobLink, RESCAN_OF, StateMark } from "./joblist";
import { UnitNote } from "./job";
import { hasDeviation, lostWords, whyNotFound } from "./located";
import { jobSignal, keepJob, partName, readJob, scannerName } from "./jobs";
import { css, lossColour } from "./palette";
import { Rounds, ScanMap, type Pin } from "./scanmap";
import {
  area,
  areaIn,
  count,
  degrees,
  fileSize,
  fine,
  fixed,
  hrefOf,
  length,
  lengthIn,
  lengthUnit,
  limits,
  percent,
  place,
  point,
  points,
  sentence,
  setQuery,
  unit,
  when,
  zoned,
} from "./settings";
import { text } from "./text";
import {
  Button,
  ConfirmButton,
  CopyLink,
  Cut,
  known,
  NumberInput,
  Pending,
  Problem,
  Swatch,
  useLoaded,
  useNewest,
} from "./widgets";

const words = text.inspections;
export const isOpen = ({ state }: { state: string }): boolean => ["queued", "running", "cancelling"].includes(state);
const share = (value: number): string => percent(value, 2);

const rowsOf = (pairs: [string, string][]) =>
  pairs.map(([name, value]) => (
    <tr key={name}>
      <th scope="row">{name}</th>
      <td class="number">{value}</td>
    </tr>
  ));

function Table({
  label,
  heads,
  children,
  ...rest
}: {
  label: string;
  heads: string[];
  children: unknown;
  class?: string;
}) {
  return (
    <div class="scroll" tabIndex={0} role="group" aria-label={label}>
      <table {...rest}>
        <thead>
          <tr>
            {heads.map((name) => (
              <th key={name} scope="col">
                {name === words.actions ? <span class="hidden">{name}</span> : name}
              </th>
            ))}
          </tr>
        </thead>
        <tbody>{children as never}</tbody>
      </table>
    </div>
  );
}

export function InspectionProgress({ job }: { job: InspectionJob }) {
  if (!isOpen(job)) return null;
  return (
    <div class="progress">
      <progress max={1} value={job.fraction} aria-label={words.progress} />
      <span class="soft" role="status">
        {job.state !== "queued" && percent(job.fraction, 0)}
      </span>
    </div>
  );
}

/** RMS deviation in a list; in its place, that the part was not found. */
function rmsOf(summary: InspectionJob["summary"]): string {
  if (summary?.not_found != null) return words.partLost;
  return summary?.deviation_rms_mm == null ? text.none : fine(summary.deviation_rms_mm);
}

/** Table of inspections, of one job or of all. */
export function InspectionTable({
  items,
  reload,
  withJob,
}: {
  items: InspectionJob[];
  reload: () => void;
  withJob?: boolean;
}) {
  useEffect(() => {
    if (!items.some(isOpen)) return undefined;
    const timer = setTimeout(reload, 1000);
    return () => clearTimeout(timer);
  }, [items]);
  const end = (job: InspectionJob) =>
    isOpen(job) ? (
      <Button onClick={() => post(`/inspections/${job.id}/cancel`).then(reload)}>{text.jobs.cancel}</Button>
    ) : (
      <ConfirmButton
        label={text.jobs.remove}
        aria-label={`${text.jobs.remove} ${when(job.created_at)}`}
        sure={text.sure(words.oneOf(when(job.created_at)))}
        onConfirm={() => remove(`/inspections/${job.id}`).then(reload)}
      />
    );
  return (
    <Table
      label={words.title}
      heads={[
        zoned(words.started),
        ...(withJob ? [words.part] : []),
        words.state,
        words.planned,
        words.measured,
        words.inAll,
        words.rms,
        words.actions,
      ]}
    >
      {items.map((job) => (
        <tr key={job.id} data-state={job.state}>
          <th scope="row">
            <a href={hrefOf(["inspections", job.id])}>{when(job.created_at)}</a>
          </th>
          {withJob && (
            <td class="name">
              <JobLink id={job.job_id} tab={["inspection"]} />
            </td>
          )}
          <td>
            <span class={`state ${job.state}`}>{text.states[job.state]}</span> <InspectionProgress job={job} />
          </td>
          <td>{job.summary ? share(job.summary.planned_of_asked) : text.none}</td>
          <td>{job.summary ? share(job.summary.measured_of_asked) : text.none}</td>
          <td>{job.summary ? share(job.summary.measured_in_all_of_asked) : text.none}</td>
          <td>{rmsOf(job.summary)}</td>
          <td>{end(job)}</td>
        </tr>
      ))}
    </Table>
  );
}

export function InspectionList(_: object) {
  const { value, error, reload, more } = useNewest<InspectionJob>("/inspections");
  return (
    <section class="runs" aria-labelledby="inspections-title">
      <h1 id="inspections-title">{words.title}</h1>
      <p class="soft">{words.hint}</p>
      {error ? <Problem error={error} /> : !value && <Pending />}
      {value &&
        (value.items.length === 0 ? (
          <p class="empty">{words.empty}</p>
        ) : (
          <InspectionTable items={value.items} reload={reload} withJob />
        ))}
      {value && <Cut page={value} onMore={more} />}
    </section>
  );
}

export function InspectionView({ id }: { id: string }) {
  const { value: job, error, reload } = useLoaded(() => ask<InspectionJob>(`/inspections/${id}`), [id]);
  const { value: planned, error: lost } = useLoaded(
    () => (job ? readJob(job.job_id) : Promise.resolve(null)),
    [job?.job_id],
  );
  const isDone = job?.state === "succeeded";
  const { value: result, error: problem } = useLoaded(
    () => (isDone ? ask<Inspection>(`/inspections/${id}/result`) : Promise.resolve(null)),
    [id, isDone],
  );
  useEffect(() => {
    if (!job || !isOpen(job)) return undefined;
    const timer = setTimeout(reload, 700);
    return () => clearTimeout(timer);
  }, [job]);
  if (error || problem || lost || !job || !planned) return <Pending error={error || problem || lost} />;
  return (
    <section class="runs inspection" aria-labelledby="inspection-title" data-state={job.state}>
      <Head job={job} planned={planned} onChange={reload} />
      {result ? <Result job={job} planned={planned} result={result} /> : isDone && <Pending />}
    </section>
  );
}

function Head({ job, planned, onChange }: { job: InspectionJob; planned: Job; onChange: () => void }) {
  const name = partName(jobSignal(planned.id)?.value ?? planned);
  return (
    <>
      <div class="title">
        <h1 id="inspection-title">{words.one(name)}</h1>
        <span class={`state ${job.state}`}>{text.states[job.state]}</span>
        <span class="soft">
          {zoned(when(job.created_at))} · {words.scanCount(job.scans.length)} · {words.methods[job.params.align.method]}
          {job.submitted_by && ` · ${text.jobs.by(job.submitted_by)}`}
        </span>
        <span class="actions">
          <a class="button" href={hrefOf(["jobs", job.job_id])}>
            {words.toPlan}
          </a>
          <a class="button" href={hrefOf(["jobs", job.job_id, "inspection"])}>
            {words.toScans}
          </a>
          {job.state === "succeeded" && (
            <a
              class="button"
              href={`${apiPath}/inspections/${job.id}/report?format=html`}
              target="_blank"
              rel="noopener"
            >
              {text.job.report}
            </a>
          )}
          {isOpen(job) && (
            <Button onClick={() => post(`/inspections/${job.id}/cancel`).then(onChange)}>{text.jobs.cancel}</Button>
          )}
          <CopyLink />
        </span>
      </div>
      <InspectionProgress job={job} />
      {job.problem && (
        <div role="alert">
          <p class="problem">
            {[
              `${job.problem.title}: ${job.problem.detail}`,
              ...job.problem.errors
                .filter(({ detail }) => !job.problem!.detail.includes(detail))
                .map(({ pointer, detail }) => `${pointer}: ${detail}`),
            ].join("\n")}
          </p>
          <p>
            {job.problem.code === "job_input_invalid" && (
              <>
                → {words.whatToDo} <a href={hrefOf(["jobs", job.job_id, "inspection"])}>{words.toScans}</a>
                {" · "}
              </>
            )}
            <a href={`problems/${job.problem.code}`}>{text.jobs.whatToDo}</a>
          </p>
        </div>
      )}
      {job.state === "cancelled" && (
        <p class="soft">
          {words.wasCancelled} <a href={hrefOf(["jobs", job.job_id, "inspection"])}>{words.toScans}</a>
        </p>
      )}
    </>
  );
}

function Result({ job, planned, result }: { job: InspectionJob; planned: Job; result: Inspection }) {
  const { value: map, error } = useLoaded(() => faceMapOf(job), [job.id]);
  const pin = useSignal<Pin | null>(null);
  const isJudged = hasDeviation(result);
  const isFitting = whyNotFound(result.alignment) !== "few_inliers";
  const asked = known(words.maps, place.value.query.get("map")) as MapKind;
  const kind = isJudged || asked !== "deviation" ? asked : "losses";
  const unjudged = <p class="warning">{words.notJudged}</p>;
  const show = (next: MapKind): void => setQuery({ map: next === "losses" ? undefined : next });
  const point = (kindOf: MapKind, at: Vector, size: number): void => {
    show(kindOf);
    pin.value = { at, size };
    document.querySelector(".inspection .view3d")?.scrollIntoView({ block: "nearest" });
  };
  return (
    <>
      <NotFound job={job} result={result} />
      <Verdict result={result} />
      <Findings result={result} />
      <Rescan job={job} isFitting={isFitting} />
      <div class="mapped">
        {error && <Problem error={error} />}
        {map ? (
          <ScanMap
            job={job}
            result={result}
            map={map}
            kind={kind}
            onKind={show}
            pin={pin.value}
            onPin={(next) => {
              pin.value = next;
            }}
          />
        ) : (
          <p class="soft" role="status">
            {text.loading}
          </p>
        )}
        <Losses result={result} onShow={(at, size) => point("losses", at, size)} />
      </div>
      <Before job={job} planned={planned} result={result} />
      <div class="columns results">
        <section>
          <h2>{words.deviation}</h2>
          {isJudged ? <Deviation result={result} onShow={(at, size) => point("deviation", at, size)} /> : unjudged}
        </section>
        <section>
          <h2>{words.extents}</h2>
          {isJudged ? <Extents result={result} /> : unjudged}
          <h2>{words.comparison}</h2>
          <Comparison result={result} />
        </section>
        <section class="whole">
          <h2>{words.regions}</h2>
          {isJudged ? <Regions result={result} /> : unjudged}
        </section>
        <section>
          <h2>{words.byView}</h2>
          <ByView result={result} />
        </section>
        <section>
          <h2>{words.alignment}</h2>
          <Alignment result={result} />
        </section>
        <section>
          <h2>{words.teach}</h2>
          {isFitting ? <Teach job={job} planned={planned} /> : <p class="warning">{words.nothingTaught}</p>}
        </section>
        <section>
          <h2>{words.taken}</h2>
          <Taken result={result} />
          <h2>{words.downloads}</h2>
          <Downloads job={job} />
        </section>
      </div>
    </>
  );
}

/** Says first that the part was not found, where it was not. */
function NotFound({ job, result }: { job: InspectionJob; result: Inspection }) {
  const reason = whyNotFound(result.alignment);
  return reason === null ? null : (
    <p id="not-found" class="problem" role="alert" data-reason={reason}>
      {lostWords(result)} <a href={hrefOf(["jobs", job.job_id, "inspection"])}>{words.toScans}</a>
    </p>
  );
}

function Verdict({ result }: { result: Inspection }) {
  const { verdict, coverage, deviation } = result;
  const figure = (id: string, value: string, name: string) => (
    <div class="figure" data-figure={id}>
      <strong>{value}</strong>
      <span>{name}</span>
    </div>
  );
  const isLater = coverage.measured_in_all_of_asked > coverage.measured_of_asked + 1e-9;
  const difference = coverage.measured_of_asked - coverage.planned_of_asked;
  const { statistics } = deviation;
  return (
    <div id="verdict" class="verdicts">
      <div class="figures">
        {figure("planned", share(coverage.planned_of_asked), words.plannedOf)}
        {figure("measured", share(coverage.measured_of_asked), words.measuredOf)}
        {figure("difference", points(difference), words.points)}
        {figure("lost", share(coverage.lost_of_asked), words.lostOf)}
        {figure("gained", share(coverage.gained_of_asked), words.gainedOf)}
        {isLater && figure("all", share(coverage.measured_in_all_of_asked), words.inAllOf)}
        {statistics && hasDeviation(result) && figure("rms", fine(statistics.rms_mm), words.rmsOf)}
      </div>
      <p>{verdict}</p>
      <UnitNote of={[verdict]} />
      {coverage.approximate && <p class="warning">{words.approximate}</p>}
    </div>
  );
}

const Findings = ({ result }: { result: Inspection }) =>
  result.findings.length === 0 ? null : (
    <section class="warnings" aria-label={words.findings}>
      {result.findings.map((finding, i) => (
        <p key={i}>{finding.detail}</p>
      ))}
    </section>
  );

const MAX_VIEWS = 1000;

/** Asks for a plan of what is missing, and shows what was asked for before. */
function Rescan({ job, isFitting }: { job: InspectionJob; isFitting: boolean }) {
  const [views, setViews] = useState(4);
  const { value, error, reload } = useLoaded(
    () => askPages<Job>(`/jobs?label=${encodeURIComponent(`${RESCAN_OF}=${job.id}`)}`),
    [job.id],
  );
  useEffect(
    () =>
      value?.items.forEach((item) => {
        if (!jobSignal(item.id)) keepJob(item);
      }),
    [value],
  );
  const start = async (): Promise<void> => {
    const made = await post<Job>(`/inspections/${job.id}/rescans`, { params: { max_views: views } });
    keepJob(made);
    reload();
  };
  const made = (value?.items ?? []).map((item) => jobSignal(item.id)?.value ?? item);
  return (
    <div class="next rescan">
      <span>
        {isFitting ? words.rescanHint : words.noRescan}
        {error && <span class="problem"> {error}</span>}
        {made.map((item) => (
          <span key={item.id} class="made">
            <br />
            <a href={hrefOf(["jobs", item.id])}>{words.rescanJob(when(item.created_at))}</a> <StateMark job={item} />
            {item.summary && <span class="soft"> {item.summary.views_text}</span>}
            {item.problem && <span class="problem"> {item.problem.detail}</span>}
            {item.state === "succeeded" && (
              <>
                {" · "}
                <a href={hrefOf(["jobs", item.id, "inspection"])}>{words.rescanScans}</a>
              </>
            )}
          </span>
        ))}
      </span>
      <span class="actions">
        <label>
          <span>{words.maxViews}</span>
          <NumberInput
            name="max_views"
            step={1}
            min={1}
            max={MAX_VIEWS}
            value={views}
            onNumber={(value) => setViews(value ?? 0)}
          />
        </label>
        <Button kind="primary" disabled={!isFitting || !(views >= 1 && views <= MAX_VIEWS)} onClick={start}>
          {words.rescan}
        </Button>
      </span>
    </div>
  );
}

const MAX_SPOTS = 5;

function Losses({ result: { losses }, onShow }: { result: Inspection; onShow: (at: Vector, size: number) => void }) {
  const most = Math.max(...losses.map((loss) => loss.of_asked), 1e-9);
  if (losses.length === 0)
    return (
      <section class="losses">
        <h2>{words.lossTitle}</h2>
        <p class="good">{words.noLosses}</p>
      </section>
    );
  return (
    <section class="losses" aria-label={words.lossTitle}>
      <h2>{words.lossTitle}</h2>
      <p class="soft">{words.lossHint}</p>
      {losses.map((loss) => (
        <details key={loss.cause} data-cause={loss.cause}>
          <summary>
            <Swatch colour={css(lossColour(loss.cause))} /> {words.losses[loss.cause] ?? loss.cause}
            <span class="number">{share(loss.of_asked)}</span>
            <span class="bar-of">
              <span style={{ width: `${(100 * loss.of_asked) / most}%` }} />
            </span>
          </summary>
          <p>{loss.detail}</p>
          <p class="soft">
            {area(loss.area_mm2)}, {text.plan.missCount(loss.spots)}
            {loss.spots > MAX_SPOTS && `; ${words.largest}`}
          </p>
          <Spots loss={loss} onShow={onShow} />
        </details>
      ))}
    </section>
  );
}

const Spots = ({ loss, onShow }: { loss: Loss; onShow: (at: Vector, size: number) => void }) => (
  <ul class="spots">
    {loss.largest.slice(0, MAX_SPOTS).map((spot, i) => (
      <li key={i}>
        <button type="button" class="row" onClick={() => onShow(spot.centre_mm, Math.max(...spot.extent_mm))}>
          <span>{area(spot.area_mm2)}</span>
          <span class="number">{words.remedies[spot.remedy] ?? spot.remedy}</span>
          <span class="soft">
            ({point(spot.centre_mm)}) {lengthUnit()}
          </span>
        </button>
      </li>
    ))}
  </ul>
);

function Deviation({
  result: { deviation },
  onShow,
}: {
  result: Inspection;
  onShow: (at: Vector, size: number) => void;
}) {
  const { histogram, statistics } = deviation;
  const plot = useMemo(
    () => ({
      x: [...histogram.area_mm2, 0].map((_, i) => lengthIn(histogram.begin_mm + i * histogram.width_mm)),
      lines: [
        {
          label: words.areaOf,
          values: [...histogram.area_mm2, histogram.area_mm2.at(-1) ?? 0].map(areaIn),
          isStepped: true,
        },
      ],
    }),
    [histogram, unit.value],
  );
  if (!statistics) return <p class="soft">{words.nothing}</p>;
  return (
    <>
      <Chart
        title={words.histogram}
        {...plot}
        xLabel={`${words.deviation}, ${lengthUnit()}`}
        yLabel={`${lengthUnit()}²`}
      />
      <p class="soft">{words.histogramNote}</p>
      <StatisticsTable statistics={statistics} />
      <p class="soft">
        {words.comparedAt(
          words.methods[deviation.alignment] ?? deviation.alignment,
          deviation.fixed_freedoms,
          count(deviation.compared_points),
        )}
      </p>
      {deviation.excluded && (
        <p class="soft">
          {words.leftOut(
            count(deviation.turned_points ?? 0),
            share(deviation.excluded.turned_of_area),
            share(deviation.excluded.off_of_area),
          )}
        </p>
      )}
      {deviation.worst.length > 0 && (
        <>
          <h3>{words.worst}</h3>
          <ul class="spots">
            {deviation.worst.map((spot, i) => (
              <li key={i}>
                <button type="button" class="row" onClick={() => onShow(spot.centre_mm, Math.sqrt(spot.area_mm2))}>
                  <span>{words.kinds[spot.kind]}</span>
                  <span class="number">{fine(spot.max_mm)}</span>
                  <span class="soft">
                    {words.spot(fine(spot.mean_mm), area(spot.area_mm2), placed(spot.centre_mm))}
                  </span>
                </button>
              </li>
            ))}
          </ul>
        </>
      )}
      {deviation.off_surface.length > 0 && (
        <>
          <h3>{words.off}</h3>
          <ul class="spots">
            {deviation.off_surface.map((heap, i) => (
              <li key={i}>
                <button type="button" class="row" onClick={() => onShow(heap.centre_mm, 10)}>
                  <span>{words.kinds[heap.kind]}</span>
                  <span class="number">{fine(heap.mean_mm)}</span>
                  <span class="soft">{words.heap(count(heap.points), placed(heap.centre_mm))}</span>
                </button>
              </li>
            ))}
          </ul>
        </>
      )}
    </>
  );
}

const StatisticsTable = ({ statistics: s }: { statistics: Statistics }) => (
  <table class="percentiles" aria-label={words.statistics}>
    <tbody>
      {rowsOf([
        [words.mean, fine(s.mean_mm)],
        [words.rms, fine(s.rms_mm)],
        [words.percentile(1), fine(s.p1_mm)],
        [words.percentile(5), fine(s.p5_mm)],
        [words.median, fine(s.p50_mm)],
        [words.percentile(95), fine(s.p95_mm)],
        [words.percentile(99), fine(s.p99_mm)],
        [words.farthest, fine(s.max_mm)],
        [words.compared, area(s.area_mm2)],
        ...(s.in_tolerance === null ? [] : [[words.inTolerance, share(s.in_tolerance)] as [string, string]]),
      ])}
    </tbody>
  </table>
);

const Extents = ({ result }: { result: Inspection }) => (
  <div class="scroll" tabIndex={0} role="group" aria-label={words.extents}>
    <table aria-label={words.extents}>
      <thead>
        <tr>
          {[words.axis, words.nominal, words.measured, text.compare.difference].map((name, i) => (
            <th key={name} scope="col" class={i ? "number" : ""}>
              {name}
            </th>
          ))}
        </tr>
      </thead>
      <tbody>
        {result.deviation.extents.map(({ nominal_mm: nominal, measured_mm: measured, max_expanded_uncertainty_mm: expanded }, i) => (
          <tr key={i}>
            <th scope="row">{"XYZ"[i]}</th>
            <td class="number">{fine(nominal)}</td>
            <td class="number">{measured === null ? words.endUnseen : expanded === null ? fine(measured) : `${fine(measured)} ± ${fine(expanded)}`}</td>
            <td class="number">{measured === null ? text.none : fine(measured - nominal)}</td>
          </tr>
        ))}
      </tbody>
    </table>
  </div>
);

function Regions({
  result: {
    deviation: { regions },
  },
}: {
  result: Inspection;
}) {
  if (regions.length === 0) return <p class="soft">{words.noRegions}</p>;
  return (
    <>
      <Table
        label={words.regions}
        heads={[
          text.regionTable.name,
          words.tolerance,
          text.regionTable.verdict,
          words.measured,
          words.expanded,
          words.range,
          words.inTolerance,
        ]}
      >
        {regions.map((region) => (
          <tr key={region.name} data-verdict={region.verdict ?? ""}>
            <th scope="row">{region.name}</th>
            <td>{region.tolerance_mm === null ? text.none : limits(region.tolerance_mm)}</td>
            <td class={region.verdict === "pass" ? "good" : region.verdict === "fail" ? "bad" : "warning"}>
              {region.verdict === null ? text.none : (words.verdicts[region.verdict] ?? region.verdict)}
            </td>
            <td
              title={
                region.excluded &&
                words.leftOutOf(share(region.excluded.turned_of_area), share(region.excluded.off_of_area))
              }
            >
              {share(region.measured)}
            </td>
            <td>{region.expanded_uncertainty_mm === null ? text.none : fine(region.expanded_uncertainty_mm)}</td>
            <td>
              {region.statistics ? `${fine(region.statistics.p1_mm)} … ${fine(region.statistics.p99_mm)}` : text.none}
            </td>
            <td>{region.statistics?.in_tolerance == null ? text.none : share(region.statistics.in_tolerance)}</td>
          </tr>
        ))}
      </Table>
      <p class="soft">{words.regionNote}</p>
    </>
  );
}

function Comparison({ result: { coverage } }: { result: Inspection }) {
  const cell = (of: number) => (
    <td class="number">
      {share(of)}
      <br />
      <span class="soft">{area(of * coverage.asked_area_mm2)}</span>
    </td>
  );
  const { both_of_asked: both, lost_of_asked: lost, gained_of_asked: gained, neither_of_asked: neither } = coverage;
  return (
    <>
      <table aria-label={words.comparison} class="match">
        <thead>
          <tr>
            <td />
            <th scope="col" class="number">
              {words.measured}
            </th>
            <th scope="col" class="number">
              {words.unmeasuredHead}
            </th>
            <th scope="col" class="number">
              {words.sum}
            </th>
          </tr>
        </thead>
        <tbody>
          <tr>
            <th scope="row">{words.planned}</th>
            {cell(both)}
            {cell(lost)}
            {cell(coverage.planned_of_asked)}
          </tr>
          <tr>
            <th scope="row">{words.unplanned}</th>
            {cell(gained)}
            {cell(neither)}
            {cell(gained + neither)}
          </tr>
          <tr>
            <th scope="row">{words.sum}</th>
            {cell(coverage.measured_of_asked)}
            {cell(lost + neither)}
            {cell(1)}
          </tr>
        </tbody>
      </table>
      <p class="soft">
        {words.band(share(coverage.lost_near_limit_of_asked), share(coverage.gained_near_limit_of_asked))}
      </p>
    </>
  );
}

const ByView = ({ result: { coverage } }: { result: Inspection }) => (
  <Table label={words.byView} heads={[words.view, words.scans, words.plannedArea, words.measuredArea, words.ofPlanned]}>
    {coverage.by_view.map((view) => (
      <tr key={view.viewpoint}>
        <th scope="row">{view.viewpoint}</th>
        <td class={view.scans === 0 ? "bad" : ""}>{view.scans || words.none}</td>
        <td>{area(view.planned_area_mm2)}</td>
        <td>{area(view.measured_area_mm2)}</td>
        <td>
          {view.planned_area_mm2 > 0 ? share(view.planned_and_measured_area_mm2 / view.planned_area_mm2) : text.none}
        </td>
      </tr>
    ))}
  </Table>
);

function Alignment({ result: { alignment: found } }: { result: Inspection }) {
  const isFound = whyNotFound(found) === null;
  const place: [string, string][] = [
    [words.partShifted, `${fine(found.part_shifted_mm)} ${words.uncertainty(fine(2 * found.part_sd.translation_mm))}`],
    [
      words.partTurned,
      `${found.part_turned_deg.toFixed(3)}° ${words.uncertainty(`${(2 * found.part_sd.rotation_deg).toFixed(3)}°`)}`,
    ],
    [
      words.translation,
      `${found.mesh_from_stated.translation_mm.map((value) => fixed(lengthIn(value), unit.value === "mm" ? 3 : 4)).join(", ")} ${lengthUnit()}`,
    ],
  ];
  const facts: [string, string][] = [
    ...(isFound ? place : []),
    [words.onPart, share(found.inlier_share)],
    [words.noise, fine(found.noise_mm)],
    [words.method, words.methods[found.method] ?? found.method],
  ];
  const kept = found.views.filter((view) => view.kept_pose);
  return (
    <>
      <dl class="facts-list">
        {facts.map(([name, value]) => (
          <>
            <dt>{name}</dt>
            <dd>{value}</dd>
          </>
        ))}
      </dl>
      {!isFound && <p class="warning">{words.placeUnknown}</p>}
      {(isFound || kept.length > 0) && (
        <p class={kept.length ? "warning" : "soft"}>{kept.length ? words.keptCount(kept.length) : words.noneKept}</p>
      )}
      <Table
        label={words.viewPoses}
        heads={[words.view, words.shifted, words.turned, words.rms, words.onPart, words.pose]}
      >
        {found.views.map((view) => (
          <tr key={view.viewpoint}>
            <th scope="row">{view.viewpoint}</th>
            <td>{isFound ? fine(view.shifted_mm) : text.none}</td>
            <td>{isFound ? `${view.turned_deg.toFixed(3)}°` : text.none}</td>
            <td>{fine(view.rms_mm)}</td>
            <td>{share(view.inlier_share)}</td>
            <td class={`wide ${view.kept_pose ? "warning" : ""}`}>
              {view.kept_pose ? (words.kept[view.kept_pose] ?? view.kept_pose) : isFound ? words.corrected : text.none}
            </td>
          </tr>
        ))}
      </Table>
    </>
  );
}

const Taken = ({ result }: { result: Inspection }) => (
  <Table
    label={words.taken}
    heads={[words.view, words.file, words.unit, words.frame, words.count, words.near, words.removed]}
  >
    {result.scans.map((scan, i) => (
      <tr key={i}>
        <th scope="row">{scan.viewpoint}</th>
        <td class="name">{scan.file}</td>
        <td>{scan.unit}</td>
        <td>{words.frames[scan.frame] ?? scan.frame}</td>
        <td>{count(scan.points)}</td>
        <td>{percent(scan.on_part)}</td>
        <td class="wide">
          {scan.removed
            .map(({ reason, points }) => `${words.reasons[reason] ?? reason}: ${count(points)}`)
            .join(", ") || text.none}
        </td>
      </tr>
    ))}
  </Table>
);

const DOWNLOADS: [string, string][] = [
  ["inspection.html", "report?format=html"],
  ["inspection.txt", "report?format=text"],
  ["inspection.json", "result"],
  ["losses.json", "losses?format=json"],
  ["coverage.csv", "losses?format=csv"],
  ["deviation.csv", "deviation?format=csv"],
  ["deviation.ply", "deviation?format=ply"],
  ["learned.json", "learned"],
];

const Downloads = ({ job }: { job: InspectionJob }) => (
  <table aria-label={words.downloads}>
    <tbody>
      {DOWNLOADS.map(([name, path]) => (
        <tr key={name}>
          <th scope="row">{words.files[name]}</th>
          <td class="number">{fileSize(job.files.find((file) => file.name === name)?.size_bytes)}</td>
          <td>
            <a href={`${apiPath}/inspections/${job.id}/${path}`} download={`${job.id}_${name}`}>
              {name}
            </a>
          </td>
        </tr>
      ))}
    </tbody>
  </table>
);

function Teach({ job, planned }: { job: InspectionJob; planned: Job }) {
  const { value: learned, error } = useLoaded(() => ask<Learned>(`/inspections/${job.id}/learned`), [job.id]);
  if (error || !learned) return <Pending error={error} />;
  const row = (name: string, estimate: Estimate | null, show: (value: number) => string) => (
    <tr key={name}>
      <th scope="row">{name}</th>
      <td class="number">{estimate ? show(estimate.value) : words.noLimit}</td>
      <td class="number">{estimate ? `${show(estimate.interval[0])} … ${show(estimate.interval[1])}` : ""}</td>
      <td class="number">{estimate ? count(estimate.count) : ""}</td>
    </tr>
  );
  const factor = (value: number): string => value.toFixed(2);
  return (
    <>
      <p class="soft">{words.teachHint}</p>
      {(learned.withheld ?? []).map(({ reason, detail }) => (
        <p key={reason} class="soft">
          {sentence(detail)}
        </p>
      ))}
      {!(learned.withheld?.length && learned.offers.length === 0) && (
        <Offers offers={learned.offers} planned={planned} job={job} />
      )}
      <table aria-label={words.estimates}>
        <thead>
          <tr>
            {[words.figure, words.value, words.interval, words.from].map((name, i) => (
              <th key={name} scope="col" class={i ? "number" : ""}>
                {name}
              </th>
            ))}
          </tr>
        </thead>
        <tbody>
          {row(words.noiseBest, learned.noise_best_mm, fine)}
          {row(words.noiseGain, learned.noise_depth_gain, factor)}
          {row(words.incidence, learned.incidence_deg, degrees)}
          {learned.incidence_by_device.map(({ device, incidence_deg: limit }) =>
            row(words.incidenceOf(device), limit, degrees),
          )}
          {row(words.lobe, learned.lobe_deg, degrees)}
          {row(words.near1, learned.depth_mm[0], length)}
          {row(words.far, learned.depth_mm[1], length)}
        </tbody>
      </table>
      <Rates title={words.byIncidence} bins={learned.by_incidence} unit="°" />
      <Rates title={words.byMirror} bins={learned.by_mirror} unit="°" />
      <Rates title={words.byDepth} bins={learned.by_depth} unit={lengthUnit()} of={lengthIn} />
    </>
  );
}

/** A point with its unit. */
const placed = (at: Vector): string => `(${point(at)}) ${lengthUnit()}`;

function Rates({
  title,
  bins,
  unit: shown,
  of = (value) => value,
}: {
  title: string;
  bins: RateBin[];
  unit: string;
  of?: (value: number) => number;
}) {
  const plot = useMemo(() => {
    const full = bins.filter(({ expected }) => expected > 0);
    return {
      x: full.map(({ range }) => of((range[0] + range[1]) / 2)),
      lines: [{ label: words.rate, values: full.map(({ expected, returned }) => returned / expected) }],
    };
  }, [bins, shown]);
  return plot.x.length < 2 ? null : (
    <Chart title={title} {...plot} xLabel={shown} yLabel={words.rate} percent yRange={[0, 1]} height={140} />
  );
}

/** What a change is offered for: the figure that was found, with its interval, and the values in use and suggested, which
 *  may be beyond it. */
function basis({ parameter, in_scanner: [field = ""], identified, from, to }: Offer): string {
  const unit = /deg$/.test(parameter ?? field) ? "°" : /mm\b/.test(parameter ?? field) ? "\u00a0mm" : "";
  const show = (value: number): string => `${Number(value.toPrecision(4))}${unit}`;
  return words.offer(
    show(identified.value),
    identified.interval.map(show).join(" … "),
    count(identified.count),
    from === null ? text.none : show(from),
    show(to),
  );
}

/** Changes that are offered; each is taken over only by a new plan that the reader starts. */
function Offers({ offers, planned, job }: { offers: Offer[]; planned: Job; job: InspectionJob }) {
  if (offers.length === 0) return <p class="good">{words.noOffers}</p>;
  const plan = (some: Offer[]): string =>
    hrefOf(["new"], {
      from: job.job_id,
      set: JSON.stringify(Object.fromEntries(some.map((offer) => [offer.parameter!, offer.to]))),
    });
  const planable = offers.filter((offer) => offer.parameter);
  const scanner = scannerName(planned);
  return (
    <>
      <ul class="offers">
        {offers.map((offer) => (
          <li key={offer.field}>
            <p>{offer.detail}</p>
            <p class="soft">{basis(offer)}</p>
            <p class="actions">
              {offer.parameter ? (
                <a class="button" href={plan([offer])}>
                  {words.planWith(`${offer.parameter} = ${offer.to}`)}
                </a>
              ) : (
                <a class="button" href={hrefOf(["specs", "scanners", scanner])}>
                  {words.setIn(offer.in_scanner.join(", "), scanner)}
                </a>
              )}
            </p>
          </li>
        ))}
      </ul>
      {planable.length > 1 && (
        <p class="actions">
          <a class="button primary" href={plan(planable)}>
            {words.planWithAll}
          </a>
        </p>
      )}
    </>
  );
}

const MAX_ROUNDS = 20;

/** Inspections that this one goes on from, the first one first; jobs of further views name them by a label. */
async function earlierOf(planned: Job): Promise<InspectionJob[]> {
  const found: InspectionJob[] = [];
  let id = planned.labels[RESCAN_OF];
  while (id && found.length < MAX_ROUNDS) {
    const before: InspectionJob = await ask<InspectionJob>(`/inspections/${encodeURIComponent(id)}`);
    found.unshift(before);
    id = (await ask<Job>(`/jobs/${before.job_id}`)).labels[RESCAN_OF];
  }
  return found;
}

/** What the further views brought, where this inspection is of a rescan. */
function Before({ job, planned, result }: { job: InspectionJob; planned: Job; result: Inspection }) {
  const { value, error } = useLoaded(async () => {
    const rounds = [...(await earlierOf(planned)), job];
    if (rounds.length < 2) return null;
    const results = await Promise.all(
      rounds.map((round) => (round === job ? result : ask<Inspection>(`/inspections/${round.id}/result`))),
    );
    return { rounds, results, maps: await Promise.all(rounds.map(faceMapOf)) };
  }, [job.id]);
  const isLater = result.coverage.measured_in_all_of_asked > result.coverage.measured_of_asked + 1e-9;
  if (error)
    return (
      <p class="soft">
        {words.beforeGone} {error}
      </p>
    );
  if (!value)
    return planned.labels[RESCAN_OF] ? <Pending /> : isLater ? <p class="soft">{words.beforeUnknown}</p> : null;
  const [one, two] = value.results.slice(-2) as [Inspection, Inspection];
  const causes = [...new Set([...one.losses, ...two.losses].map(({ cause }) => cause))];
  const lost = (of: Inspection, cause: string): number => of.losses.find((loss) => loss.cause === cause)?.of_asked ?? 0;
  const line = (name: string, before: number, after: number, isStrong = false) => (
    <tr key={name} class={isStrong ? "strong" : ""}>
      <th scope="row">{name}</th>
      <td class="number">{share(before)}</td>
      <td class="number">{share(after)}</td>
      <td class="number">{points(after - before)}</td>
    </tr>
  );
  return (
    <section class="compare rounds" aria-labelledby="rounds-title">
      <h2 id="rounds-title">{words.roundsTitle}</h2>
      <p class="soft">
        {words.follows}{" "}
        <a href={hrefOf(["inspections", value.rounds.at(-2)!.id])}>{when(value.rounds.at(-2)!.created_at)}</a>
        {". "}
        {text.compare.coupled}
      </p>
      <Rounds maps={value.maps} results={value.results} />
      <table id="rounds">
        <thead>
          <tr>
            <td />
            <th scope="col" class="number">
              {words.rounds.before}
            </th>
            <th scope="col" class="number">
              {words.rounds.after}
            </th>
            <th scope="col" class="number">
              {words.pointsShort}
            </th>
          </tr>
        </thead>
        <tbody>
          {line(words.inAllOf, one.coverage.measured_in_all_of_asked, two.coverage.measured_in_all_of_asked, true)}
          {line(words.roundPlanned, one.coverage.planned_of_asked, two.coverage.planned_of_asked)}
          {line(words.roundMeasured, one.coverage.measured_of_asked, two.coverage.measured_of_asked)}
          {line(words.roundLost, one.coverage.lost_of_asked, two.coverage.lost_of_asked, true)}
          {causes.map((cause) => line(words.losses[cause] ?? cause, lost(one, cause), lost(two, cause)))}
        </tbody>
      </table>
    </section>
  );
}

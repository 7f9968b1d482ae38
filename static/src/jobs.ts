// The jobs that the page knows, each a signal of its own so that one event draws one row; and the live events that change them.
import { effect, signal, type Signal } from "@preact/signals";
import { ask, askPages, Refused, serverNow, type Job, type Mesh, type Page, type Region, type Note } from "./api";
import { Stream, type LiveEvent } from "./live";

const jobs = new Map<string, Signal<Job>>();
/** Ids, which rise with time: the newest first. */
export const jobIds = signal<string[]>([]);
/** How far the list was read with the filter that is set: a token where the server has older jobs, and the oldest one read. */
export const listed = signal<{ token: string | null; last: string } | null>(null);
const meshes = new Map<string, Signal<Mesh | null>>();

/** Kinds of events of jobs; the server's own list is `EventKind`. */
const PROGRESS = "progress";
const DELETED = "deleted";
export const ENDED = ["succeeded", "failed", "cancelled"];

export const jobSignal = (id: string): Signal<Job> | undefined => jobs.get(id);

/** Jobs that were deleted: an answer that was on its way by then does not bring them back. */
const deleted = new Set<string>();
/** Limit of these, and of the jobs that come one by one before the oldest are dropped: a display on a wall runs for months. */
const MANY = 1000;
let added = 0;

const newestFirst = (): void => { jobIds.value = [...jobs.keys()].sort().reverse(); };

function store(job: Job): void {
  const known = jobs.get(job.id);
  // An answer that was on its way when the end was told: an end is final.
  if (known && ENDED.includes(known.peek().state) && !ENDED.includes(job.state)) return;
  // Lists lack what only the whole job has.
  if (known) known.value = { ...known.peek(), ...job };
  else if (!deleted.has(job.id)) jobs.set(job.id, signal(job));
}

export function keepJob(job: Job): void {
  const isNew = !jobs.has(job.id);
  store(job);
  if (!isNew) return;
  newestFirst();
  if ((added += 1) > MANY && !/[?&]q=/.test(location.hash)) dropOld();
}

/** Keeps of the jobs that have ended those of the newest page, and what the address names; the list begins with that page again. */
function dropOld(): void {
  added = 0;
  for (const id of jobIds.peek().slice(PAGE_SIZE)) if (ENDED.includes(jobs.get(id)!.peek().state) && !location.hash.includes(id)) jobs.delete(id);
  const parts = new Set([...jobs.values()].map((job) => job.peek().mesh_id));
  for (const id of meshes.keys()) if (!parts.has(id)) meshes.delete(id);
  newestFirst();
  void readList();
}

export function forgetJob(id: string): void {
  deleted.add(id);
  if (deleted.size > MANY) deleted.delete(deleted.values().next().value!);
  jobs.delete(id);
  jobIds.value = jobIds.peek().filter((other) => other !== id);
}

export function meshSignal(id: string): Signal<Mesh | null> {
  const known = meshes.get(id);
  if (known) return known;
  const made = signal<Mesh | null>(null);
  meshes.set(id, made);
  void readMesh(id, made);
  return made;
}

/** Meshes that could not be read, and why the last of them could not. */
const unread = new Map<string, Signal<Mesh | null>>();
export const meshProblem = signal("");

async function readMesh(id: string, made: Signal<Mesh | null>): Promise<void> {
  try {
    made.value = await ask<Mesh>(`/meshes/${id}`);
    unread.delete(id);
  } catch (error) {
    // One that was deleted is not there the next time either.
    if (error instanceof Refused && error.status === 404) unread.delete(id);
    else {
      unread.set(id, made);
      meshProblem.value = (error as Error).message;
    }
  }
  if (unread.size === 0) meshProblem.value = "";
}

const readMeshes = (): void => unread.forEach((made, id) => void readMesh(id, made));

/** Counts how often the reader asked to read once more what could not be read. */
export const retries = signal(0);
export function tryAgain(): void {
  retries.value += 1;
  readMeshes();
}

export const partName = (job: Job): string => meshSignal(job.mesh_id).value?.name ?? job.part_number ?? job.id.slice(0, 8);
export const cellName = (job: Job): string => (typeof job.cell === "string" ? job.cell : job.cell.name);
export const scannerName = (job: Job): string => (typeof job.scanner === "string" ? job.scanner : job.scanner.name);

const PAGE_SIZE = 100;

/** Filter of the list, as the query of the server has it; `&state=failed` for one. */
let filter = "";

/** Reads the newest page that fits a filter, or the one after `token`. */
async function listJobs(asked: string, token?: string): Promise<void> {
  const before = jobIds.peek();
  const page = await ask<Page<Job>>(`/jobs?page_size=${PAGE_SIZE}${asked}${token ? `&page_token=${encodeURIComponent(token)}` : ""}`);
  const items = page.items;
  const oldest = items.at(-1)?.id;
  if (!token && !asked) {
    // What the list no longer has was deleted while nobody listened.
    const listed = new Set(items.map((job) => job.id));
    before.filter((id) => !listed.has(id) && (!oldest || id > oldest)).forEach(forgetJob);
  }
  items.forEach(store);
  newestFirst();
  if (asked === filter) listed.value = { token: page.next_page_token ?? null, last: oldest ?? "" };
}

/** Reason for which the list with the filter that is set could not be read; empty once it was. */
export const listProblem = signal("");

let reads = 0;

/** Reads the newest page with the filter that is set; what fails is told in place of the list, unless it was asked for once more since. */
export async function readList(): Promise<void> {
  const read = (reads += 1);
  const problem = await listJobs(filter).then(() => "", (error: Error) => error.message);
  if (read === reads) listProblem.value = problem;
}

export const listMore = (): Promise<void> => listJobs(filter, listed.peek()?.token ?? undefined);

/** Sets the filter: of jobs that are not read yet, the server finds those that fit. */
export function filterJobs(query: Record<string, string>): Promise<void> {
  const wanted = Object.entries(query).map(([name, value]) => `&${name}=${encodeURIComponent(value)}`).join("");
  // The whole list is read when the stream begins.
  if (wanted === filter) return Promise.resolve();
  filter = wanted;
  [listed.value, listProblem.value] = [null, ""];
  return readList();
}

/** Reads older jobs of the search; null where there are none, or nothing is searched. */
export const findMore = signal<(() => Promise<void>) | null>(null);
let searches = 0;

/** Reads the newest jobs that fit each of some queries, besides those of the list. */
export async function findJobs(queries: string[], wanted = PAGE_SIZE): Promise<void> {
  const search = (searches += 1);
  findMore.value = null;
  const pages = await Promise.all(queries.map((query) => askPages<Job>(`/jobs?${query}`, wanted)));
  pages.forEach(({ items }) => items.forEach(store));
  newestFirst();
  if (search === searches && pages.some((page) => page.next_page_token)) findMore.value = () => findJobs(queries, wanted + PAGE_SIZE);
}

/** Reads a job with everything, regions and warnings too. */
export async function readJob(id: string): Promise<Job> {
  const job = await ask<Job>(`/jobs/${id}`);
  keepJob(job);
  return job;
}

export async function readRegions(id: string): Promise<void> {
  const whole = await ask<{ regions: Region[]; warnings: Note[] }>(`/jobs/${id}?fields=regions,warnings`);
  const job = jobs.get(id);
  if (job) job.value = { ...job.peek(), ...whole };
}

// One request a job at a time, and one more when something happened meanwhile.
const reading = new Map<string, boolean>();

const RETRY_MS = 2000;

/** Reads a job anew, also after an attempt that failed; forgets one that was deleted. */
export async function refresh(id: string): Promise<void> {
  if (reading.has(id)) { reading.set(id, true); return; }
  reading.set(id, false);
  await readJob(id).catch((error) => { if (error.code === "job_not_found") forgetJob(id); else setTimeout(refresh, RETRY_MS, id); });
  const again = reading.get(id);
  reading.delete(id);
  if (again) await refresh(id);
}

// A place became free: everybody behind moves up, which one list tells.
let movingUp: ReturnType<typeof setTimeout> | null = null;
function moveUp(): void {
  movingUp ??= setTimeout(() => {
    movingUp = null;
    if (![...jobs.values()].some((job) => job.peek().state === "queued")) return;
    ask<Page<Job>>("/jobs?state=queued&fields=queue_position&page_size=1000").then((page) => page.items.forEach((item) => {
      const job = jobs.get(item.id);
      if (job?.peek().state === "queued") job.value = { ...job.peek(), queue_position: item.queue_position };
    }), () => {});
  }, 100);
}

interface JobEvent { job_id: string; stage: string | null; fraction: number; state: string }

export function applyEvent({ kind, data }: LiveEvent): void {
  const about = data as JobEvent;
  const job = jobs.get(about.job_id);
  if (kind === DELETED) forgetJob(about.job_id);
  else if (kind === PROGRESS) {
    // A progress that was sent before the end may come after the end was read; of a job that is not read, nothing is shown.
    if (!job || ENDED.includes(job.peek().state)) return;
    job.value = { ...job.peek(), stage: about.stage, fraction: about.fraction, state: about.state };
  } else {
    if (job) job.value = { ...job.peek(), state: about.state, stage: about.stage, fraction: about.fraction };
    void refresh(about.job_id);
    moveUp();
  }
}

/** Events handled since the page was opened, by id: what a test of dropped connections holds against the server's. */
export const seen = { events: [] as string[], resets: 0 };
const REMEMBERED = 20_000;

export const stream = new Stream({
  path: "/events",
  numbered: true,
  onReset: () => {
    seen.resets += 1;
    void readList();
    if (filter) void listJobs("").catch(() => {});
  },
  onEvent: (event) => {
    if (seen.events.length < REMEMBERED) seen.events.push(event.id);
    applyEvent(event);
  },
});

effect(() => { if (stream.connection.value === "live") readMeshes(); });

/** Seconds left, from the time that the present fraction took. */
export function secondsLeft(job: Job): number | null {
  if (job.state !== "running" || !job.started_at || job.fraction < 0.05) return null;
  const spent = (serverNow() - Date.parse(job.started_at)) / 1000;
  return Math.max(0, (spent * (1 - job.fraction)) / job.fraction);
}

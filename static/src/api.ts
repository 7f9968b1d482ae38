// Requests to the server, and its session: relative to the page, so that everything works below any path.
import { signal } from "@preact/signals";
import { text } from "./text";

export const apiPath = new URL("api/v1", document.baseURI).pathname;

/** A request that the server refused, with its problem document (RFC 9457). */
export class Refused extends Error {
  code: string;
  status: number;
  fields: ProblemField[];

  /** `etag`: that of the version which is stored, where the refusal names it. */
  constructor(problem: { code?: string; title?: string; detail?: string; errors?: ProblemField[] }, status: number, readonly etag = "") {
    const fields = problem.errors ?? [];
    // The detail of a single fault names its field.
    const listed = problem.detail && fields.length < 2 ? [] : fields;
    // Ids are the server's words; the reader came by an address.
    super(/^(job|run|mesh|inspection|calibration)_not_found/.test(problem.code ?? "") ? text.notFound : [problem.detail || problem.title, ...listed.map((field) => `${field.pointer}: ${field.detail}`)].join("\n"));
    this.code = problem.code ?? "";
    this.status = status;
    this.fields = fields;
  }
}

export interface ProblemField { pointer: string; detail: string }

// The key is exchanged for a session: its cookie, which no script can read, goes with every request and stream. The header
// says that this page asks; no other site's page can send it.
export const asPage = { "X-Vantage-Session": "1" };
const SIGNED_IN = "vantage-signed-in";
const KEY_CODES = ["key_missing", "key_wrong", "session_ended"];

export const isSignedIn = signal(localStorage.getItem(SIGNED_IN) !== null);
/** Set while the server asks for its key: the dialog answers it. */
export const keyRequest = signal<{ answer: (key: string) => void; problem: string } | null>(null);

const etagOf = (response: Response): string => response.headers.get("etag") ?? "";

async function refusal(response: Response): Promise<Refused> {
  const problem = await response.json().catch(() => ({ title: `${response.status} ${response.statusText}` }));
  return new Refused(problem, response.status, etagOf(response));
}

/** Lead of the server's clock over this computer's, ms: the largest that an answer tells, since one may be late or from the browser's store. */
let aheadMs = -Infinity;
export const serverNow = (): number => Date.now() + (Number.isFinite(aheadMs) ? aheadMs : 0);

async function send(path: string, options: RequestInit): Promise<Response> {
  const response = await fetch(apiPath + path, { ...options, headers: { ...asPage, ...options.headers } }).catch((error: Error) => {
    throw error.name === "AbortError" ? error : new Error(text.noAnswer);
  });
  aheadMs = Math.max(aheadMs, Date.parse(response.headers.get("date") ?? "") - Date.now() || -Infinity);
  if (!response.ok) throw await refusal(response);
  return response;
}

let signingIn: Promise<void> | null = null;

function signIn(): Promise<void> {
  signingIn ??= exchangeKey("").finally(() => { signingIn = null; });
  return signingIn;
}

async function exchangeKey(problem: string): Promise<void> {
  const key = await new Promise<string>((answer) => { keyRequest.value = { answer, problem }; });
  try {
    await send("/session", { method: "POST", headers: { Authorization: `Bearer ${key.trim()}` } });
  } catch (error) {
    return exchangeKey((error as Error).message);
  }
  keyRequest.value = null;
  localStorage.setItem(SIGNED_IN, "1");
  isSignedIn.value = true;
}

// What a view will ask for, while its code is still on the way.
const ahead = new Map<string, Promise<Response>>();
const AHEAD_MS = 10_000;

/** Begins a request; whoever asks for the same soon gets its answer. */
export function askAhead(path: string): void {
  const asked = request(path);
  asked.catch(() => ahead.delete(path));
  ahead.set(path, asked);
  setTimeout(() => ahead.delete(path), AHEAD_MS);
}

/** Response of a request; asks for the key first where the server wants one. */
export async function request(path: string, options: RequestInit = {}): Promise<Response> {
  const asked = options.method ? undefined : ahead.get(path);
  if (asked) { ahead.delete(path); return asked; }
  try {
    return await send(path, options);
  } catch (error) {
    if (!(error instanceof Refused) || !KEY_CODES.includes(error.code)) throw error;
    await signIn();
    return request(path, options);
  }
}

export async function ask<T>(path: string, options: RequestInit = {}): Promise<T> {
  const response = await request(path, options);
  return (response.status === 204 ? null : await response.json()) as T;
}

const MAX_PAGE = 1000;

/** The first entries of a list, as many as are wanted, page by page. */
export async function askPages<T>(path: string, wanted = Infinity): Promise<Page<T>> {
  const items: T[] = [];
  let token: string | null = null;
  do {
    const query = new URLSearchParams({ page_size: String(Math.min(MAX_PAGE, wanted - items.length)), ...(token && { page_token: token }) });
    const page: Page<T> = await ask<Page<T>>(`${path}${path.includes("?") ? "&" : "?"}${query}`);
    items.push(...page.items);
    token = page.next_page_token ?? null;
  } while (token && items.length < wanted);
  return { items, next_page_token: token };
}

/** Answer that the server may keep waiting, until `left`. A hidden page waits for none, since a browser has six connections to a
 * server for all its pages; it asks anew when it is seen. */
export async function askSeen<T>(path: string, left: AbortSignal): Promise<T> {
  for (;;) {
    const phase = new AbortController();
    const end = (): void => phase.abort();
    const isSeen = !document.hidden;
    document.addEventListener("visibilitychange", end);
    left.addEventListener("abort", end);
    try {
      left.throwIfAborted();
      if (isSeen) return await ask<T>(path, { signal: phase.signal });
      await new Promise((ended) => { phase.signal.addEventListener("abort", ended); });
    } catch (error) {
      if (left.aborted || !phase.signal.aborted) throw error;
    } finally {
      document.removeEventListener("visibilitychange", end);
      left.removeEventListener("abort", end);
    }
  }
}

/** A document with the entity tag of its version. */
export async function askVersion<T>(path: string): Promise<{ value: T; etag: string }> {
  const response = await request(path);
  return { value: await response.json() as T, etag: etagOf(response) };
}

/** Stores a specification: a new one, or in place of the version that has the tag. Answers the tag of what is stored then. */
export const putVersion = (path: string, body: unknown, etag: string): Promise<string> =>
  request(path, { method: "PUT", headers: { "Content-Type": "application/json", ...(etag && { "If-Match": etag }) }, body: JSON.stringify(body) }).then(etagOf);

/** Request with a body, if there is one. */
const sender = (method: string) => <T>(path: string, body?: unknown, headers: Record<string, string> = {}): Promise<T> =>
  ask<T>(path, { method, headers: { ...(body !== undefined && { "Content-Type": "application/json" }), ...headers }, body: JSON.stringify(body) });

export const post = sender("POST");
export const put = sender("PUT");
export const remove = sender("DELETE");

export async function signOut(): Promise<void> {
  localStorage.removeItem(SIGNED_IN);
  // A session that is over already is as good.
  await send("/session", { method: "DELETE" }).catch(() => null);
  location.reload();
}

/** A key under which a repeated request starts one job. */
export const idempotencyKey = (): Record<string, string> =>
  ({ "Idempotency-Key": crypto.getRandomValues(new Uint32Array(4)).join("-") });

/** Uploads a file with its progress, which fetch cannot tell; `known` is a path whose answer asks for the key, if there is one, first. */
async function upload<T>(path: string, known: string, file: File, onProgress: (share: number) => void): Promise<T> {
  // Before megabytes leave.
  await ask(known);
  return new Promise((resolve, reject) => {
    const sender = new XMLHttpRequest();
    sender.open("POST", `${apiPath}${path}`);
    for (const [name, value] of Object.entries(asPage)) sender.setRequestHeader(name, value);
    sender.responseType = "json";
    sender.upload.onprogress = (event) => onProgress(event.total ? event.loaded / event.total : 0);
    sender.onload = () => (sender.status < 300 ? resolve(sender.response as T)
      : reject(new Refused(sender.response ?? { title: sender.statusText }, sender.status)));
    sender.onerror = () => reject(new Error(text.noAnswer));
    sender.send(file);
  });
}

export const uploadMesh = (file: File, unit: string, onProgress: (share: number) => void): Promise<Mesh> =>
  upload(`/meshes?${new URLSearchParams({ unit, name: file.name.slice(0, 200) })}`, "/meshes?page_size=1", file, onProgress);

/** Uploads a scan of a job; what is empty is found out by the server. */
export function uploadScan(job: string, file: File, given: { view: string; unit: string; frame: string }, onProgress: (share: number) => void): Promise<Scan> {
  const query = new URLSearchParams({ name: file.name.slice(0, 200) });
  Object.entries(given).forEach(([name, value]) => { if (value) query.set(name, value); });
  return upload(`/jobs/${job}/scans?${query}`, `/jobs/${job}/scans?page_size=1`, file, onProgress);
}

export type Vector = [number, number, number];
export interface Pose { translation_mm: Vector; quaternion_xyzw: [number, number, number, number] }
/** A pose as specifications may write it. */
export type GivenPose = Pose | { rpy_deg: Vector; translation_mm: Vector };
export interface Box { min: Vector; max: Vector }
export interface Note { code: string; detail: string; remedy: string; pointer?: string }

export interface Mesh {
  id: string; name: string | null; unit: string; sha256: string; size_bytes: number; created_at: string;
  health: {
    format: string; triangles: number; triangles_in_file: number; vertices: number; bbox_mm: Box; area_mm2: number;
    volume_mm3: number | null; watertight: boolean; bodies: number; degenerate_triangles: number; duplicate_triangles: number;
    boundary_edges: number; non_manifold_edges: number; inconsistent_edges: number; flipped_bodies: number; warnings: Omit<Note, "pointer">[];
  };
}

export interface MissedGroup {
  reason: string; spots: number; area_mm2: number; of_asked: number; fix_known: boolean; fix_text: string; partial_text?: string | null;
  recovers_mm2: number; added_views: number; set: Record<string, unknown>; text: string;
}

export interface Summary {
  level: string; title: string; verdict: string; verdict_text: string; views: number; views_text: string;
  coverage: Record<"of_asked" | "of_coverable" | "of_total" | "of_visible", number>;
  coverage_text: string; grades: Record<string, number>; cycle_secs: number | null; cycle_text: string | null;
  /** Cycle of the program that the robot runs; with `set`, where there is a `command`, the plan's own motion takes the same time. */
  program_cycle?: { cycle_secs: number; set: Record<string, unknown>; command?: string | null } | null;
  cycle_parts: { moving_secs: number; settling_secs: number; scanning_secs: number; turning_secs: number } | null;
  action: { text: string; set: Record<string, unknown>; to_of_asked: number; from_of_asked: number } | null;
  missed: MissedGroup[]; missed_text: string; setups: number;
  /** Absent in jobs of earlier releases. */
  headline?: { name: string; share: number; independent: boolean; meaning: string }[];
  /** True of further views: shares are of the area that earlier scans left open. */
  of_open?: boolean;
}

export interface Region {
  name: string; kind?: string; tolerance_mm?: number | null; asked_area_mm2: number; samples?: number; target?: number | null; of_asked: number;
  met?: boolean | null; why_unmet?: string | null;
  /** On samples that views were not chosen on; absent in plans of earlier releases. */
  independent_of_asked?: number | null; independent_standard_error?: number | null; independently_met?: boolean | null;
}

export interface Job {
  id: string; state: string; stage: string | null; fraction: number; queue_position: number | null; mesh_id: string;
  cell: string | { name: string }; scanner: string | { name: string }; labels: Record<string, string>;
  part_number: string | null; serial: string | null; priority: number; created_at: string; started_at: string | null;
  ended_at: string | null; submitted_by: string | null; timings: Record<string, number>;
  results: { name: string; size_bytes: number | null }[]; summary: Summary | null;
  problem: { code: string; title: string; detail: string; errors: ProblemField[] } | null;
  warnings?: Note[]; regions?: Region[]; params?: Record<string, unknown>; plan_sha256: string | null;
}

export interface Page<T> { items: T[]; next_page_token?: string | null }

export interface Device {
  name: string; scanner_from_device: Pose; width_px: number; height_px: number; fx: number; fy: number; cx: number; cy: number;
  skew: number; distortion: number[]; incidence_max_deg: number;
  /** Ends of its depth of field along its axis, mm, where that limits it. */
  in_focus_from_mm?: number | null; in_focus_to_mm?: number | null;
}

export interface Scanner { name: string; depth_mm: { near: number; best: number; far: number }; devices: Device[] }

export interface Viewpoint {
  id: number; candidate: number; label: string; part_from_scanner: Pose; gain_of_asked: number; score: number;
  station: { table_angle_deg: number; joints_deg: number[]; posture?: string; clearance_mm?: number | null } | null;
  rejected: string | null;
}

export interface Remedy {
  kind: string; text: string; views: { part_from_scanner: Pose; area_mm2: number; tilt_deg: number; standoff_mm: number }[];
  of_spot: number; area_mm2: number; tried: number; turn?: { text: string } | null; table_from_part?: Pose | null;
  camera_deg?: number | null; projector_deg?: number | null;
}

export interface Spot {
  area_mm2: number; centre_mm: Vector; extent_mm: Vector; faces: number[]; remedy?: Remedy | null;
}

export interface MissedListing {
  asked_area_mm2: number; missed_area_mm2: number;
  missed: { reason: string; area_mm2: number; spots: number; listing: Spot[]; remedy: Remedy | null }[];
}

export interface Plan {
  part: { bbox_mm: Box; area_mm2: number; triangles: number }; scanner: Scanner;
  cell: { name: string; base_from_table: Pose; table_from_part: Pose; flange_from_scanner: Pose; robot: string; turntable: string }
    | null;
  coverage: {
    asked_area_mm2: number; coverable_area_mm2: number; measured_area_mm2: number; of_asked: number;
    of_coverable: number; of_total: number; grades: Record<string, number>; curve: number[];
  };
  viewpoints: Viewpoint[]; sequence: number[]; bound: { views_lower: number; of_asked_upper?: number | null } | null;
  setups?: { table_from_part: Pose; viewpoints: number[]; turn?: { text: string } | null }[];
  advice?: { kind: string; set: Record<string, unknown>; turn?: { text: string } | null }[];
  params: { score: { c: number; d: number; angle: string }; limits: { camera_deg: number | null; projector_deg: number | null };
    motion: { clearance_mm: number }; part: { fixture_mesh?: string | null }; selection: { max_views?: number | null } }
    & Record<string, unknown>;
  motion?: Record<string, number> | null; stopped_because: string;
}

export interface Step {
  op: "move_joints" | "settle" | "scan"; joints_deg?: number[]; table_angle_deg?: number; via?: number[][];
  duration_secs?: number; secs?: number; viewpoint?: number; capture_secs?: number; speed_fraction?: number;
}

export interface Program { steps: Step[]; home_deg: number[]; cycle_secs: number; robot: string; turntable: string; setup?: number }

export interface Shape {
  kind: "box" | "cylinder" | "capsule" | "mesh"; size_mm?: Vector; radius_mm?: number; height_mm?: number; length_mm?: number;
  mesh?: string;
}
export interface Body { name: string; owner_from_body?: GivenPose; shape: Shape }
/** Body that a link of the arm carries. */
export interface LinkBody extends Body { link: number }
export interface Axis { min_deg: number; max_deg: number; max_speed_deg_per_s: number }
export interface Robot {
  name: string; joints: Axis[]; kinematics: Record<string, unknown> & { kind: string };
  links: { link: number; name: string; from_mm: Vector; to_mm: Vector; radius_mm: number }[]; surfaces?: LinkBody[];
}
export interface Turntable {
  name: string; plate_diameter_mm: number; plate_thickness_mm: number; body?: Body[];
  rotation: { kind: string; min_deg?: number; max_deg?: number };
}
export interface ScannerSpec {
  name: string; depth_mm: { near: number; best: number; far: number }; body?: Body[]; stated_volume_mm?: Vector | null;
  practical_volume_mm: Vector;
}
export interface Cell {
  name: string; robot: string | Robot; scanner: string | ScannerSpec; turntable: string | Turntable; base_from_table: GivenPose;
  flange_from_scanner: GivenPose; mount?: Body[]; obstacles?: Body[]; cable?: LinkBody[]; floor_mm?: number | null; home_deg: number[];
}

export interface Run {
  id: string; state: string; reason: string; mode: string; cell: string; job_id: string | null; setup: number; step: number;
  steps: number; scans: number; elapsed_secs: number; planned_secs: number; created_at: string; ended_at: string | null;
  detail: string | null; notice: string; objections: string[]; speed_override: number; time_factor: number; single_step: boolean;
  armed_by: string | null; submitted_by: string | null; coverage: { measured_of_asked: number; planned_of_asked: number } | null;
  jitter: Record<string, number> | null; from_step: number;
  /** Where a run that is over left arm and table; absent in runs of earlier releases. */
  last_measured?: RunSample["measured"] | null;
}

export interface RunSample {
  sequence: number; elapsed_secs: number; step: number; state: string; deviation_deg: number;
  measured: { joints_deg: number[]; table_angle_deg: number }; base_from_scanner: Pose;
}

/** A step that a run completed. */
export interface StepRecord { step: number; actual_secs: number; axis_deviation_deg: number; measured: RunSample["measured"] }

export interface Spread { rms_rotation_deg: number; rms_translation_mm: number; max_rotation_deg: number; max_translation_mm: number }
export interface ResidualSummary { used: number; dropped: number; spread: Spread; variance_factor: number; chi2_p: number }
export interface CalibrationFinding { code: string; severity: string; observations: string[]; detail: string }
export interface CalibrationJob {
  id: string; state: string; cell: string; solve: string; hold_out: number; observations: number; submitted_by: string | null;
  created_at: string; ended_at: string | null; summary: ResidualSummary | null; point_at_best_focus_sd_mm: number | null;
  findings: CalibrationFinding[]; warnings?: Note[]; problem: Job["problem"];
}
export interface Residual {
  id: string; rotation_deg: number; translation_mm: number; shift_mm: number[]; table_angle_deg: number; used: boolean;
  held_out: boolean; dropped_because?: string | null; predicted_translation_mm?: number | null;
}
export interface Calibration {
  flange_from_scanner: Pose; base_from_table?: Pose | null; plate_from_board: Pose; residuals: Residual[]; summary: ResidualSummary;
  observability: { spread_deg: number[]; rotation_sd_deg: number; translation_sd_mm: number;
    weakest?: { freedom: string; axis: number[]; sd_deg?: number | null; sd_mm?: number | null } | null };
  leave_one_out: { spread: Spread }; held_out?: Spread | null; sigma: Record<"robot_deg" | "robot_mm" | "board_deg" | "board_mm", number>;
  sigma_estimated: boolean; arm_sigma_source?: string | null; table_runout: { order: number; radial_mm: number; axial_mm: number }[]; temperature_c: number | null;
}

export interface Scan {
  id: string; job_id: string; view: number | null; name: string | null; unit: string | null; frame: string | null; size_bytes: number;
  created_at: string;
}

export interface InspectionParams {
  align: { method: string; region: string | null; prior_deg: number | null; prior_mm: number | null };
  compare: { tolerance_mm: number } & Record<string, number>;
}
export interface InspectionJob {
  id: string; job_id: string; state: string; scans: string[]; run_id: string | null; params: InspectionParams; fraction: number;
  submitted_by: string | null; created_at: string; ended_at: string | null; files: { name: string; size_bytes: number | null }[];
  problem: Job["problem"];
  summary: { planned_of_asked: number; measured_of_asked: number; measured_in_all_of_asked: number; unexplained_of_asked: number;
    deviation_rms_mm: number | null;
    /** Reason for which the part was not found; absent in inspections of earlier releases. */
    not_found?: string | null } | null;
}

export interface LostSpot { area_mm2: number; centre_mm: Vector; extent_mm: Vector; remedy: string }
export interface Loss { cause: string; detail: string; area_mm2: number; of_asked: number; spots: number; largest: LostSpot[] }
export interface Statistics {
  area_mm2: number; mean_mm: number; rms_mm: number; p1_mm: number; p5_mm: number; p50_mm: number; p95_mm: number; p99_mm: number;
  max_mm: number; in_tolerance: number | null;
}
export interface RegionDeviation {
  name: string; tolerance_mm: number | null; measured: number; verdict: string | null; expanded_uncertainty_mm: number | null;
  statistics: Statistics | null; excluded?: ExcludedShares;
}
/** What figures and verdicts leave out, shares; inspections of earlier versions do not tell. */
export interface ExcludedShares { turned_of_points: number; turned_of_area: number; off_of_area: number }
export interface Estimate { value: number; interval: [number, number]; count: number }
export interface Offer {
  field: string; parameter: string | null; in_scanner: string[]; from: number | null; to: number; identified: Estimate; detail: string;
}
export interface RateBin { range: [number, number]; expected: number; returned: number }
export interface Learned {
  noise_best_mm: Estimate | null; noise_depth_gain: Estimate | null; incidence_deg: Estimate | null; lobe_deg: Estimate | null;
  incidence_by_device: { device: string; incidence_deg: Estimate | null }[]; depth_mm: [Estimate | null, Estimate | null];
  by_incidence: RateBin[]; by_mirror: RateBin[]; by_depth: RateBin[]; offers: Offer[]; withheld?: { reason: string; detail: string }[];
}
export interface Inspection {
  params: InspectionParams;
  scans: { viewpoint: number; file: string; unit: string; frame: string; points: number; in_frusta: number; on_part: number;
    removed: { reason: string; points: number }[] }[];
  findings: { code: string; file: string | null; viewpoint: number | null; detail: string }[];
  verdict: string;
  alignment: {
    method: string; mesh_from_stated: Pose; part_turned_deg: number; part_shifted_mm: number; noise_mm: number; inlier_share: number;
    /** Reason for which the part was not found; absent in results of earlier releases. */
    not_found?: string | null;
    part_sd: { rotation_deg: number; translation_mm: number };
    views: { viewpoint: number; points: number; inlier_share: number; rms_mm: number; turned_deg: number; shifted_mm: number;
      kept_pose: string | null }[];
  };
  coverage: {
    asked_area_mm2: number; planned_of_asked: number; measured_of_asked: number; measured_in_all_of_asked: number; both_of_asked: number;
    lost_of_asked: number; gained_of_asked: number; neither_of_asked: number; lost_near_limit_of_asked: number;
    gained_near_limit_of_asked: number; approximate: boolean;
    by_view: { viewpoint: number; scans: number; planned_area_mm2: number; measured_area_mm2: number; planned_and_measured_area_mm2: number }[];
  };
  losses: Loss[];
  deviation: {
    alignment: string; fixed_freedoms: number; compared_points: number; turned_points?: number; excluded?: ExcludedShares; statistics: Statistics | null;
    histogram: { begin_mm: number; width_mm: number; area_mm2: number[] };
    extents: { nominal_mm: number; measured_mm: number | null; max_expanded_uncertainty_mm: number | null }[]; regions: RegionDeviation[];
    worst: { kind: string; centre_mm: Vector; area_mm2: number; mean_mm: number; max_mm: number }[];
    off_surface: { kind: string; centre_mm: Vector; points: number; mean_mm: number }[];
  };
  offers: Offer[];
}

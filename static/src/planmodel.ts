// What the plan view knows of a job: plan, preview, coverage of each face, missed spots; and what follows from them.
import { Matrix4, Vector3 } from "three";
import { ask, type Cell, type Job, type MissedListing, type Plan, type Pose, type Remedy, type Spot, type Turntable } from "./api";
import { meaningOf } from "./bytes";
import { cellName } from "./jobs";
import { coverageBytes, fixtureOf, preview, type Preview } from "./mesh";
import { opticsOf, type Optics } from "./optics";
import { matrixOf, poseOf, product, shift, turnX, turnY, turnZ } from "./poses";
import type { Plate } from "./worker";

export interface MissedAt { reason: string; spot: Spot }

export interface Model {
  job: Job; plan: Plan; mesh: Preview; fixture: Preview | null; bytes: Uint8Array; missed: MissedListing; optics: Optics; plateRadius: number;
  /** Missed spot of a face of the preview. */
  missedAt: (face: number) => MissedAt | null;
}

async function plateRadiusOf(job: Job): Promise<number> {
  const cell = typeof job.cell === "string" ? await ask<Cell>(`/cells/${encodeURIComponent(job.cell)}`) : (job.cell as unknown as Cell);
  const table = typeof cell.turntable === "string" ? await ask<Turntable>(`/turntables/${encodeURIComponent(cell.turntable)}`) : cell.turntable;
  return table.plate_diameter_mm / 2;
}

export async function modelOf(job: Job): Promise<Model> {
  const [plan, mesh, bytes, missed, plateRadius] = await Promise.all([
    ask<Plan>(`/jobs/${job.id}/plan`), preview(job.mesh_id), coverageBytes(job.id), ask<MissedListing>(`/jobs/${job.id}/missed`),
    cellName(job) === "none" ? 0 : plateRadiusOf(job).catch(() => 250),
  ]);
  let bySource: Map<number, MissedAt> | null = null;
  const missedAt = (face: number): MissedAt | null => {
    bySource ??= new Map(missed.missed.flatMap(({ reason, listing }) =>
      listing.flatMap((spot) => spot.faces.map((source): [number, MissedAt] => [source, { reason, spot }]))));
    for (const source of mesh.sourceFaces(face)) {
      const found = bySource.get(source);
      if (found) return found;
    }
    return null;
  };
  return { job, plan, mesh, fixture: await fixtureOf(plan), bytes, missed, optics: opticsOf(plan.scanner, plan.params.score), plateRadius, missedAt };
}

/** A viewpoint as the reader has it: planned, moved, dropped or added. */
export interface EditedView {
  id: number; pose: Pose; /** Where it was planned or added. */ origin: Pose; isAdded: boolean; isUsed: boolean; wasUsed: boolean; setup: number; move: Move;
}
export interface Move { tiltX: number; tiltY: number; roll: number; standoff: number }
export const STILL: Move = { tiltX: 0, tiltY: 0, roll: 0, standoff: 0 };

export const setupOf = (plan: Plan, view: number): number =>
  Math.max(0, (plan.setups ?? []).findIndex((setup) => setup.viewpoints.includes(view)));

export const plannedViews = (plan: Plan): EditedView[] => plan.viewpoints.map((view) => ({
  id: view.id, pose: view.part_from_scanner, origin: view.part_from_scanner, isAdded: false, isUsed: !view.rejected, wasUsed: !view.rejected,
  setup: setupOf(plan, view.id), move: STILL,
}));

/** How the part lies on the plate in a setup; null without a cell. */
export const tableFromPart = ({ cell, setups }: Plan, setup: number): Pose | null =>
  (cell ? setups?.[setup]?.table_from_part ?? cell.table_from_part : null);

/** The plate beneath the part while a view is taken: what hides surface from below. */
export function plateOf({ plan, plateRadius }: Model, view: EditedView): Plate | null {
  const pose = tableFromPart(plan, view.setup);
  return pose && { tableFromPart: pose, radius: plateRadius };
}

/** Index of the setup that an address names, the first where it names none; null for the part as it is in its file. */
export function shownSetup(plan: Plan, named: string | null): number | null {
  if (!plan.cell || named === "file") return null;
  const setup = Number(named);
  return setup > 0 && plan.setups?.[setup] ? setup : 0;
}

const rounded = (value: number, digits: number): number => Number(value.toFixed(digits));

/** What was changed of the views by hand, for the address: number, whether it is used, its move, and of an added one its setup and pose. */
export function editsOf(views: EditedView[]): string | undefined {
  const edits = views.filter((view) => isEdited([view])).map(({ id, isUsed, isAdded, move, setup, origin }) => [
    id, Number(isUsed), move.tiltX, move.tiltY, move.roll, move.standoff,
    ...(isAdded ? [setup, ...origin.translation_mm.map((value) => rounded(value, 3)), ...origin.quaternion_xyzw.map((value) => rounded(value, 6))] : []),
  ].join("_"));
  return edits.length > 0 ? edits.join("*") : undefined;
}

/** The planned views with the changes that an address has; what cannot be read changes nothing. */
export function editedViews(plan: Plan, best: number, edits: string | null): EditedView[] {
  const views = plannedViews(plan);
  for (const edit of edits?.split("*") ?? []) {
    const [id = -1, used, tiltX = 0, tiltY = 0, roll = 0, standoff = 0, setup = 0, ...pose] = edit.split("_").map(Number);
    if (![id, tiltX, tiltY, roll, standoff, setup, ...pose].every(Number.isFinite)) continue;
    if (pose.length === 7) {
      const [x, y, z, ...quaternion] = pose as [number, number, number, ...number[]];
      const origin: Pose = { translation_mm: [x, y, z], quaternion_xyzw: quaternion as Pose["quaternion_xyzw"] };
      if (!views.some((view) => view.id === id)) views.push({ id, pose: origin, origin, isAdded: true, isUsed: true, wasUsed: false, setup, move: STILL });
    }
    const view = views.find((view) => view.id === id);
    if (!view) continue;
    const move = { tiltX, tiltY, roll, standoff };
    view.isUsed = used === 1;
    if (Object.values(move).some((value) => value !== 0)) Object.assign(view, { move, pose: moved(view.origin, best, move) });
  }
  return views;
}

const RAD = Math.PI / 180;

/** Turns and shifts a view about the point on its axis at the best distance. */
export function moved(pose: Pose, best: number, { tiltX, tiltY, roll, standoff }: Move): Pose {
  return poseOf(product(matrixOf(pose), shift(0, 0, best), turnX(tiltX * RAD), turnY(tiltY * RAD), turnZ(roll * RAD), shift(0, 0, -best - standoff)));
}

/** View along the normal of a spot, from the best distance. */
export function lookingAt(point: number[], normal: number[], best: number): Pose {
  const z = new Vector3().fromArray(normal).negate().normalize();
  const x = new Vector3().crossVectors(Math.abs(z.z) < 0.9 ? new Vector3(0, 0, 1) : new Vector3(1, 0, 0), z).normalize();
  const matrix = new Matrix4().makeBasis(x, new Vector3().crossVectors(z, x), z);
  matrix.setPosition(new Vector3().fromArray(point).addScaledVector(z, -best));
  return poseOf(matrix);
}

export const isEdited = (views: EditedView[]): boolean =>
  views.some((view) => view.isAdded || view.isUsed !== view.wasUsed || view.pose !== view.origin);

const GRADE_ABOVE: [string, number][] = [["A", 0.5], ["B", 0], ["C", -0.5], ["D", -Infinity]];
/** Grade of a quality (`src/planning/verdict/grade.rs`). */
export const gradeOf = (quality: number): string => GRADE_ABOVE.find(([, above]) => quality > above)![0];

interface Interest { region: unknown; target?: number; name?: string }

const MAX_SETUPS = 4;

/** Parameters for one more setup: all that the advice on the plan carries where it turns the part so, else the poses themselves. */
function furtherSetup({ advice, setups, cell, params, viewpoints }: Plan, { turn, table_from_part: pose, views }: Remedy): Record<string, unknown> {
  const same = advice?.find((one) => one.kind === "turn_over" && one.turn?.text === turn?.text);
  if (same) return same.set;
  const standing = setups?.map((setup) => setup.table_from_part) ?? (cell ? [cell.table_from_part] : []);
  // A fixture holds one setup.
  if (params.part.fixture_mesh || standing.length >= MAX_SETUPS) return {};
  const [needed, limit] = [viewpoints.length + views.length, params.selection.max_views];
  return {
    setups: Math.max(2, standing.length + 1), ...(pose && standing.length > 0 && { "part.resting_poses": [...standing, pose] }),
    ...(limit && limit < needed && { "selection.max_views": needed }),
  };
}

/** Parameters that apply the remedy of one spot: its viewpoints as candidates, and the spot as a region that is to be measured. */
export function remedySet({ job, plan }: Model, spot: Spot, remedy: Remedy): Record<string, unknown> {
  if (remedy.kind === "none") return {};
  if (remedy.kind === "setup") return furtherSetup(plan, remedy);
  const params = (job.params ?? {}) as { candidates?: { poses?: Pose[] }; regions?: { interest?: Interest[] } };
  const poses = [...(params.candidates?.poses ?? []), ...remedy.views.map((view) => view.part_from_scanner)];
  const target = Math.floor(98 * Math.min(1, remedy.of_spot)) / 100;
  const interest = [...(params.regions?.interest ?? []), { region: { kind: "faces", faces: spot.faces }, target }];
  return {
    "candidates.poses": poses, "regions.interest": interest,
    ...(remedy.camera_deg && { "limits.camera_deg": remedy.camera_deg }), ...(remedy.projector_deg && { "limits.projector_deg": remedy.projector_deg }),
  };
}

/** Areas of the preview by meaning of its faces. */
export function areasBy({ mesh, bytes }: Model): Map<string, number> {
  const byByte = new Float64Array(256);
  for (let face = 0; face < bytes.length; face += 1) byByte[bytes[face]!]! += mesh.areas[face]!;
  const areas = new Map<string, number>();
  byByte.forEach((area, byte) => { if (area > 0) areas.set(meaningOf(byte), (areas.get(meaningOf(byte)) ?? 0) + area); });
  return areas;
}

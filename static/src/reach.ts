// Reach of a cell as `src/planning/studies/reach.rs` counts it: a cube stands in the middle of the plate, and the scanner looks at its
// centre from all around. Joints are found by damped steps (S. R. Buss and J.-S. Kim 2005, *Selectively damped least squares for
// inverse kinematics*, section 2) from many beginnings, for any arm; the planner solves in closed form where there is one.
import { Matrix4, Vector3 } from "three";
import { halton, PRIMES, type ClearanceScene } from "./collide";
import { linkFrames, matrixOf, product } from "./poses";
import type { Cell, Robot, ScannerSpec } from "./api";

export const ELEVATIONS = 19;
export const AZIMUTHS = 24;
/** Clearance that the study keeps, mm. */
export const CLEARANCE_MM = 5;
const RAD = Math.PI / 180;
const BEGINNINGS = 48;
const MAX_STEPS = 40;
/** Exact enough to say that a pose is reached: mm, and radians times this length. */
const CLOSE_MM = 0.05;
const RADIAN_MM = 300;
const DAMPING = 1e-3;
const NUDGE = 1e-5;
/** Solutions are one if no joint differs by more, degrees. */
const SAME_DEG = 0.5;

/** Fate of a direction: reached, in reach but something collides, out of reach. */
export type Reached = 0 | 1 | 2;
export interface ReachMap { fates: Uint8Array; elevations: number; directions: number }

/** Cube on the plate, as triangles of nine numbers, its corner in its origin. */
export function cube(edge: number): Float32Array {
  const corner = (i: number): number[] => [0, 1, 2].map((axis) => ((i >> axis) & 1) * edge);
  const quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]] as const;
  return new Float32Array(quads.flatMap(([a, b, c, d]) => [a, b, c, a, c, d].flatMap(corner)));
}

/** Direction from the cube's centre to the scanner. */
export function direction(elevation: number, azimuth: number): Vector3 {
  const [polar, around] = [(0.5 * Math.PI * elevation) / (ELEVATIONS - 1), (2 * Math.PI * azimuth) / AZIMUTHS];
  return new Vector3(Math.sin(polar) * Math.cos(around), Math.sin(polar) * Math.sin(around), Math.cos(polar));
}

/** Scanner in the table frame, looking at the cube's centre, its baseline level. */
function view(elevation: number, azimuth: number, half: number, distance: number): Matrix4 {
  const out = direction(elevation, azimuth);
  const around = (2 * Math.PI * azimuth) / AZIMUTHS;
  const x = new Vector3(-Math.sin(around), Math.cos(around), 0);
  const z = out.clone().negate();
  const at = out.multiplyScalar(distance).add(new Vector3(0, 0, half));
  return new Matrix4().makeBasis(x, new Vector3().crossVectors(z, x), z).setPosition(at);
}

const flange = (robot: Robot, joints: readonly number[]): Float64Array => Float64Array.from(linkFrames(robot, joints)[6]!.elements);

/** What is left between two poses: place in mm and turn as an arc of a radius of `RADIAN_MM`. */
function error(from: Float64Array, to: Float64Array): number[] {
  const turn = [0, 0, 0];
  for (const axis of [0, 4, 8]) {
    turn[0]! += 0.5 * (from[axis + 1]! * to[axis + 2]! - from[axis + 2]! * to[axis + 1]!);
    turn[1]! += 0.5 * (from[axis + 2]! * to[axis]! - from[axis]! * to[axis + 2]!);
    turn[2]! += 0.5 * (from[axis]! * to[axis + 1]! - from[axis + 1]! * to[axis]!);
  }
  return [to[12]! - from[12]!, to[13]! - from[13]!, to[14]! - from[14]!, ...turn.map((value) => RADIAN_MM * value)];
}

/** Solution of six linear equations by elimination with pivots. */
function solved(rows: number[][]): number[] {
  for (let i = 0; i < 6; i += 1) {
    let pivot = i;
    for (let r = i + 1; r < 6; r += 1) if (Math.abs(rows[r]![i]!) > Math.abs(rows[pivot]![i]!)) pivot = r;
    [rows[i], rows[pivot]] = [rows[pivot]!, rows[i]!];
    const own = rows[i]!;
    for (let r = 0; r < 6; r += 1) {
      if (r === i) continue;
      const row = rows[r]!;
      const factor = row[i]! / own[i]!;
      for (let c = i; c < 7; c += 1) row[c]! -= factor * own[c]!;
    }
  }
  return rows.map((row, i) => row[6]! / row[i]!);
}

/** Joints that bring the flange to a pose, degrees, or `null` where the steps from a beginning do not lead there. */
function stepped(robot: Robot, target: Float64Array, beginning: number[]): number[] | null {
  const joints = [...beginning];
  for (let step = 0; step < MAX_STEPS; step += 1) {
    const at = flange(robot, joints);
    const left = error(at, target);
    const isTurned = at[0]! * target[0]! + at[5]! * target[5]! + at[10]! * target[10]! > 0;
    if (Math.hypot(...left) < CLOSE_MM && isTurned) return joints;
    const columns = joints.map((value, i) => {
      const nudged = [...joints];
      nudged[i] = value + NUDGE / RAD;
      return error(at, flange(robot, nudged)).map((moved) => moved / NUDGE);
    });
    // (JᵀJ + λI) Δ = Jᵀe, λ as a share of the trace.
    const normal = columns.map((a) => [...columns.map((b) => a.reduce((sum, value, i) => sum + value * b[i]!, 0)), a.reduce((sum, value, i) => sum + value * left[i]!, 0)]);
    const damping = DAMPING * Math.min(1, Math.hypot(...left) / RADIAN_MM) * normal.reduce((sum, row, i) => sum + row[i]!, 0) / 6;
    normal.forEach((row, i) => { row[i]! += damping + 1e-9; });
    const change = solved(normal).map((value) => value / RAD);
    const largest = Math.max(...change.map(Math.abs));
    if (!Number.isFinite(largest)) return null;
    const share = Math.min(1, 40 / largest);
    change.forEach((value, i) => { joints[i]! += share * value; });
  }
  return null;
}

/** The same posture within the limits, each joint turned by whole turns; `null` if there is none. */
function within(robot: Robot, joints: number[]): number[] | null {
  const turned = joints.map((deg, i) => {
    const { min_deg: low, max_deg: high } = robot.joints[i]!;
    const first = deg - 360 * Math.floor((deg - low) / 360);
    return first <= high ? first : NaN;
  });
  return turned.some(Number.isNaN) ? null : turned;
}

/** Directions one by one, with what became of each: the caller may pause in between. */
export function* reach(cell: Cell, robot: Robot, scanner: ScannerSpec, scene: ClearanceScene, edge: number): Generator<Reached> {
  const beginnings = Array.from({ length: BEGINNINGS }, (_, n) =>
    robot.joints.map(({ min_deg: low, max_deg: high }, i) => Math.max(low, -180) + (Math.min(high, 180) - Math.max(low, -180)) * halton(n + 1, PRIMES[i]!)));
  const scannerFromFlange = matrixOf(cell.flange_from_scanner).invert();
  let known: number[][] = [cell.home_deg.slice(0, 6)];
  for (let elevation = 0; elevation < ELEVATIONS; elevation += 1) {
    for (let azimuth = 0; azimuth < AZIMUTHS; azimuth += 1) {
      const pose = product(matrixOf(cell.base_from_table), view(elevation, azimuth, edge / 2, edge / 2 + scanner.depth_mm.best), scannerFromFlange);
      const target = Float64Array.from(pose.elements);
      const found: number[][] = [];
      let fate: Reached = 2;
      // Postures of the direction before lead to those of this one.
      for (const beginning of [...known, ...beginnings]) {
        const solution = stepped(robot, target, beginning);
        const joints = solution && within(robot, solution);
        if (!joints || found.some((other) => other.every((deg, i) => Math.abs(deg - joints[i]!) < SAME_DEG))) continue;
        found.push(joints);
        fate = 1;
        if (scene.isClear([...joints, 0])) { fate = 0; break; }
      }
      if (found.length > 0) known = found;
      yield fate;
    }
  }
}

/** The map of all directions: an elevation counts if one of its azimuths is reached, since the table turns. */
export function mapOf(fates: Uint8Array): ReachMap {
  const isReached = (elevation: number): boolean => fates.subarray(elevation * AZIMUTHS, (elevation + 1) * AZIMUTHS).includes(0);
  const elevations = Array.from({ length: ELEVATIONS }, (_, i) => isReached(i)).filter(Boolean).length;
  return { fates, elevations, directions: fates.filter((fate) => fate === 0).length };
}

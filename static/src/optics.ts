// The definition of visibility for one point and one viewpoint, as `src/planning/visibility/view.rs` has it: order of the
// causes, lens with distortion, incidence against each device, quality. Plain numbers, for the worker.
import type { Pose, Scanner } from "./api";

export type Rigid = Float64Array; // Rows of a 3 × 4 matrix.

export interface Optics {
  near: number; best: number; far: number;
  /** Half ranges of the working depth below and above best focus, in which all devices are in focus. */
  halves: [number, number];
  devices: { lens: Lens; scannerCentre: [number, number, number]; deviceFromScanner: Rigid; minCos: number; inFocus: [number, number] }[];
  angleWeight: number; distanceWeight: number; isRayAngle: boolean; referenceRad: number;
}

interface Lens {
  fx: number; fy: number; cx: number; cy: number; skew: number; k: number[]; width: number; height: number; radius2: number;
}

const NAMES = ["left", "right", "projector"] as const;
const RAD = Math.PI / 180;
const MIN_HALF_RANGE_MM = 1e-3;

export function rigid({ translation_mm: [x, y, z], quaternion_xyzw: [a, b, c, w] }: Pose): Rigid {
  return Float64Array.of(
    1 - 2 * (b * b + c * c), 2 * (a * b - c * w), 2 * (a * c + b * w), x,
    2 * (a * b + c * w), 1 - 2 * (a * a + c * c), 2 * (b * c - a * w), y,
    2 * (a * c - b * w), 2 * (b * c + a * w), 1 - 2 * (a * a + b * b), z,
  );
}

export function inverse(m: Rigid): Rigid {
  const out = new Float64Array(12);
  for (let r = 0; r < 3; r += 1) {
    for (let c = 0; c < 3; c += 1) out[4 * r + c] = m[4 * c + r]!;
    out[4 * r + 3] = -(m[r]! * m[3]! + m[4 + r]! * m[7]! + m[8 + r]! * m[11]!);
  }
  return out;
}

export function apply(m: Rigid, x: number, y: number, z: number): [number, number, number] {
  return [m[0]! * x + m[1]! * y + m[2]! * z + m[3]!, m[4]! * x + m[5]! * y + m[6]! * z + m[7]!,
    m[8]! * x + m[9]! * y + m[10]! * z + m[11]!];
}

const turn = (m: Rigid, x: number, y: number, z: number): [number, number, number] =>
  [m[0]! * x + m[1]! * y + m[2]! * z, m[4]! * x + m[5]! * y + m[6]! * z, m[8]! * x + m[9]! * y + m[10]! * z];

/** Largest radius, squared, at which the distorted image still grows: beyond it points would fold back into the image. */
function fieldRadius2(k: number[]): number {
  for (let r2 = 0; r2 < 4; r2 += 1e-3) {
    if (1 + 3 * k[0]! * r2 + 5 * k[1]! * r2 ** 2 + 7 * k[4]! * r2 ** 3 <= 0) return r2;
  }
  return Infinity;
}

/** Optics of a plan: its scanner, whose limits are those in force. */
export function opticsOf(scanner: Scanner, score: { c: number; d: number; angle: string }): Optics {
  const { near, best, far } = scanner.depth_mm;
  const devices = NAMES.map((name): Optics["devices"][number] => {
    const device = scanner.devices.find((device) => device.name === name)!;
    const k = device.distortion;
    return {
      lens: { fx: device.fx, fy: device.fy, cx: device.cx, cy: device.cy, skew: device.skew, k, width: device.width_px,
        height: device.height_px, radius2: fieldRadius2(k) },
      scannerCentre: device.scanner_from_device.translation_mm,
      deviceFromScanner: inverse(rigid(device.scanner_from_device)),
      minCos: Math.cos(device.incidence_max_deg * RAD),
      inFocus: [device.in_focus_from_mm ?? -Infinity, device.in_focus_to_mm ?? Infinity],
    };
  });
  // On the scanner's axis a device's own depth is a line of the scanner's: its third row.
  const ends = (end: 0 | 1): number[] => devices.map(({ inFocus, deviceFromScanner: m }) => (inFocus[end] - m[11]!) / m[10]!);
  const halves = [best - Math.max(near, ...ends(0)), Math.min(far, ...ends(1)) - best].map((half) => Math.max(half, MIN_HALF_RANGE_MM)) as [number, number];
  const projector = scanner.devices.find((device) => device.name === "projector")! as { incidence_own_deg?: number } &
    Scanner["devices"][number];
  return {
    near, best, far, halves, devices, angleWeight: score.c, distanceWeight: score.d, isRayAngle: score.angle === "ray",
    referenceRad: (projector.incidence_own_deg ?? projector.incidence_max_deg) * RAD,
  };
}

/** True if the lens images a point of its device's frame (Bouguet's model). */
function images(lens: Lens, x: number, y: number, z: number): boolean {
  if (z <= 0) return false;
  const [nx, ny] = [x / z, y / z];
  const r2 = nx * nx + ny * ny;
  if (r2 > lens.radius2) return false;
  const [k1, k2, p1, p2, k3] = lens.k as [number, number, number, number, number];
  const radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
  const dx = nx * radial + 2 * p1 * nx * ny + p2 * (r2 + 2 * nx * nx);
  const dy = ny * radial + p1 * (r2 + 2 * ny * ny) + 2 * p2 * nx * ny;
  const u = lens.fx * (dx + lens.skew * dy) + lens.cx;
  const v = lens.fy * dy + lens.cy;
  return u >= 0 && u < lens.width && v >= 0 && v < lens.height;
}

const FIELD_STEPS = 40;

/** Width and height of what all devices see at best focus, on the lines y = 0 and x = 0 of the scanner's frame, mm. */
export function commonField({ devices, best }: Optics): [number, number] {
  const reach = (x: number, y: number): number => {
    let [inside, outside] = [0, 2 * best];
    for (let i = 0; i < FIELD_STEPS; i += 1) {
      const middle = (inside + outside) / 2;
      if (devices.every(({ lens, deviceFromScanner }) => images(lens, ...apply(deviceFromScanner, x * middle, y * middle, best)))) inside = middle;
      else outside = middle;
    }
    return inside;
  };
  return [reach(1, 0) + reach(-1, 0), reach(0, 1) + reach(0, -1)];
}

export interface View { scannerFromPart: Rigid; centres: [number, number, number][] }

export function viewOf(optics: Optics, partFromScanner: Pose): View {
  const pose = rigid(partFromScanner);
  return { scannerFromPart: inverse(pose), centres: optics.devices.map((device) => apply(pose, ...device.scannerCentre)) };
}

export interface Optical { cause: string | null; incidenceDeg: number; depthMm: number; quality: number }

const within = (x: number): number => Math.max(-1, Math.min(1, x));

/** First step before any shadow at which a point fails, its largest incidence against the devices, depth and quality. */
export function evaluate(optics: Optics, view: View, p: number[], n: number[]): Optical {
  const [px, py, pz] = p as [number, number, number];
  const [nx, ny, nz] = n as [number, number, number];
  const s = apply(view.scannerFromPart, px, py, pz);
  let faces = true;
  let frame: string | null = null;
  let incidence: string | null = null;
  let minCos = 1;
  let isInDepth = optics.near <= s[2] && s[2] <= optics.far;
  for (let i = 0; i < 3; i += 1) {
    const device = optics.devices[i]!;
    const [cx, cy, cz] = view.centres[i]!;
    const [tx, ty, tz] = [cx - px, cy - py, cz - pz];
    const cos = (nx * tx + ny * ty + nz * tz) / Math.hypot(tx, ty, tz);
    minCos = Math.min(minCos, cos);
    faces &&= cos > 0;
    if (cos < device.minCos) incidence ??= `incidence_${NAMES[i]}`;
    const [x, y, z] = apply(device.deviceFromScanner, ...s);
    isInDepth &&= device.inFocus[0] <= z && z <= device.inFocus[1];
    if (!frame && !images(device.lens, x, y, z)) frame = `frame_${NAMES[i]}`;
  }
  const cause = !faces ? "facing" : !isInDepth ? "depth" : frame ?? incidence;
  const t = turn(view.scannerFromPart, nx, ny, nz);
  const cos = optics.isRayAngle ? -(t[0] * s[0] + t[1] * s[1] + t[2] * s[2]) / Math.hypot(...s) : -t[2];
  const off = Math.abs(s[2] - optics.best);
  const half = optics.halves[s[2] < optics.best ? 0 : 1];
  const quality = optics.angleWeight * within(1 - (2 * Math.acos(within(cos))) / optics.referenceRad)
    + optics.distanceWeight * within(1 - (2 * off) / half);
  return { cause, incidenceDeg: Math.acos(within(minCos)) / RAD, depthMm: s[2], quality };
}

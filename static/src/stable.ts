// The ways in which a part can stand on a plate, as `src/geometry/stable_poses.rs` finds them: the flat faces of its convex hull
// above which its centre of mass lies, the likeliest first (K. Goldberg and others 1999, *Part pose statistics*, IEEE
// Transactions on Robotics and Automation 15(5)).
import { Vector3 } from "three";
import { ConvexHull } from "three/addons/math/ConvexHull.js";

type Hull = InstanceType<typeof ConvexHull>;
type Face = Hull["faces"][number];

/** A face to stand on: the direction that points down, and the share of all ways to stand. */
export interface StablePose { down: [number, number, number]; share: number }

const ALIKE_RAD = (0.5 * Math.PI) / 180;
const TIPPING_RAD = (3 * Math.PI) / 180;
const MAX_POSES = 12;
/** Corners are told apart to this share of the part's size. */
const SAME_CORNER = 1e-6;

/** Corners of the triangles, each once. */
function cornersOf(positions: Float32Array, size: number): Vector3[] {
  const seen = new Set<string>();
  const made: Vector3[] = [];
  const step = size * SAME_CORNER;
  for (let i = 0; i < positions.length; i += 3) {
    const [x, y, z] = [positions[i]!, positions[i + 1]!, positions[i + 2]!];
    const key = `${Math.round(x / step)},${Math.round(y / step)},${Math.round(z / step)}`;
    if (seen.has(key)) continue;
    seen.add(key);
    made.push(new Vector3(x, y, z));
  }
  return made;
}

interface Box { min: Vector3; max: Vector3; middle: Vector3; size: number }

function boxOf(positions: Float32Array): Box {
  const [min, max, point] = [new Vector3(Infinity, Infinity, Infinity), new Vector3(-Infinity, -Infinity, -Infinity), new Vector3()];
  for (let i = 0; i < positions.length; i += 3) { point.fromArray(positions, i); min.min(point); max.max(point); }
  return { min, max, middle: min.clone().add(max).multiplyScalar(0.5), size: min.distanceTo(max) };
}

/** Six times the volume of the tetrahedra from `middle` to triangles, and their centre of mass from there. */
function centreOf(triangles: Iterable<[Vector3, Vector3, Vector3]>, middle: Vector3): { volume: number; centre: Vector3 } {
  let volume = 0;
  const moment = new Vector3();
  const [p, q, r] = [new Vector3(), new Vector3(), new Vector3()];
  for (const [a, b, c] of triangles) {
    p.subVectors(a, middle); q.subVectors(b, middle); r.subVectors(c, middle);
    const sixth = p.dot(new Vector3().crossVectors(q, r));
    volume += sixth;
    moment.addScaledVector(p.add(q).add(r), sixth / 4);
  }
  return { volume, centre: volume === 0 ? middle.clone() : moment.divideScalar(volume).add(middle) };
}

function* trianglesOf(positions: Float32Array): Generator<[Vector3, Vector3, Vector3]> {
  for (let i = 0; i < positions.length; i += 9) {
    yield [new Vector3().fromArray(positions, i), new Vector3().fromArray(positions, i + 3), new Vector3().fromArray(positions, i + 6)];
  }
}

const cornersOfFace = (face: Face): [Vector3, Vector3, Vector3] =>
  [face.getEdge(0).head().point, face.getEdge(1).head().point, face.getEdge(2).head().point];

/** Centre of mass of the enclosed volume; of the hull where the surface encloses none that means something. */
function centreOfMass(positions: Float32Array, hull: Hull, { min, max, middle }: Box): Vector3 {
  const { volume, centre } = centreOf(trianglesOf(positions), middle);
  const edges = max.clone().sub(min);
  const whole = edges.x * edges.y * edges.z;
  const isSensible = volume > 6e-3 * whole && volume <= 6 * whole && centre.clone().clamp(min, max).equals(centre);
  return isSensible ? centre : centreOf(hull.faces.map(cornersOfFace), middle).centre;
}

/** Triangles of each flat face of the hull. */
function flatFaces(hull: Hull): Face[][] {
  const taken = new Set<Face>();
  return hull.faces.flatMap((seed) => {
    if (taken.has(seed)) return [];
    taken.add(seed);
    const [face, open]: [Face[], Face[]] = [[], [seed]];
    for (let at = open.pop(); at; at = open.pop()) {
      face.push(at);
      for (let i = 0; i < 3; i += 1) {
        const next = at.getEdge(i).twin!.face;
        if (taken.has(next) || next.normal.angleTo(seed.normal) > ALIKE_RAD) continue;
        taken.add(next);
        open.push(next);
      }
    }
    return [face];
  });
}

/** Solid angle of a triangle (A. van Oosterom and J. Strackee 1983, *The Solid Angle of a Plane Triangle*). */
function solidAngle(corners: [Vector3, Vector3, Vector3], from: Vector3): number {
  const [a, b, c] = corners.map((corner) => corner.clone().sub(from)) as [Vector3, Vector3, Vector3];
  const [la, lb, lc] = [a.length(), b.length(), c.length()];
  const divisor = la * lb * lc + a.dot(b) * lc + a.dot(c) * lb + b.dot(c) * la;
  return 2 * Math.atan2(Math.abs(a.dot(new Vector3().crossVectors(b, c))), divisor);
}

function standingOn(face: Face[], centre: Vector3, size: number): StablePose | null {
  const down = face.reduce((sum, { normal, area }) => sum.addScaledVector(normal, area), new Vector3()).normalize();
  const height = cornersOfFace(face[0]!)[0].clone().sub(centre).dot(down);
  const foot = centre.clone().addScaledVector(down, height);
  let least = Infinity;
  for (const triangle of face) {
    for (let i = 0; i < 3; i += 1) {
      const edge = triangle.getEdge(i);
      if (face.includes(edge.twin!.face)) continue;
      const [from, to] = [edge.tail()!.point, edge.head().point];
      const along = to.clone().sub(from).normalize();
      least = Math.min(least, foot.clone().sub(from).dot(new Vector3().crossVectors(down, along)));
    }
  }
  const stands = height > SAME_CORNER * size && least >= height * Math.tan(TIPPING_RAD);
  const share = face.reduce((sum, triangle) => sum + solidAngle(cornersOfFace(triangle), centre), 0) / (4 * Math.PI);
  return stands ? { down: down.toArray(), share } : null;
}

/** Ways to stand, the likeliest first, of triangles as nine numbers each; none for what has no volume. */
export function stablePoses(positions: Float32Array): StablePose[] {
  const box = boxOf(positions);
  const corners = cornersOf(positions, box.size);
  const edges = box.max.clone().sub(box.min);
  if (corners.length < 4 || Math.min(edges.x, edges.y, edges.z) <= SAME_CORNER * box.size) return [];
  const hull = new ConvexHull().setFromPoints(corners);
  const centre = centreOfMass(positions, hull, box);
  const found = flatFaces(hull).flatMap((face) => standingOn(face, centre, box.size) ?? []).sort((a, b) => b.share - a.share);
  const all = found.reduce((sum, { share }) => sum + share, 0);
  return found.slice(0, MAX_POSES).map(({ down, share }) => ({ down, share: share / all }));
}

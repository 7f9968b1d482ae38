// Solids of the scene: bodies and arms of specifications, viewpoints and their frustums, the plate.
import {
  BoxGeometry, BufferGeometry, CapsuleGeometry, Color, ConeGeometry, CylinderGeometry, DoubleSide, Float32BufferAttribute, Group,
  InstancedMesh, LineBasicMaterial, LineSegments, Matrix4, Mesh, MeshBasicMaterial, MeshLambertMaterial, Object3D, Quaternion,
  Vector3,
} from "three";
import type { Body, Device, Pose, Robot, Scanner, Turntable } from "./api";
import { preview, type Preview } from "./mesh";
import { DEVICES, type Rgb } from "./palette";
import { linkFrames, matrixOf } from "./poses";

export interface Look { colour: number; opacity?: number }

export const material = ({ colour, opacity = 1 }: Look): MeshLambertMaterial =>
  new MeshLambertMaterial({ color: colour, transparent: opacity < 1, opacity, depthWrite: opacity === 1 });

export function place<T extends Object3D>(object: T, matrix: Matrix4): T {
  object.matrixAutoUpdate = false;
  object.matrix.copy(matrix);
  object.matrixWorldNeedsUpdate = true;
  return object;
}

/** Stands a solid that three.js has along y along z. */
const upright = <T extends BufferGeometry>(geometry: T): T => geometry.rotateX(Math.PI / 2);

/** Previews of the meshes that bodies name, by id. */
export type BodyMeshes = Record<string, Preview>;

/** Reads the meshes that bodies name. One that the server does not keep is left out: a file on the machine that made the cell. */
export async function bodyMeshes(bodies: (Body | null | undefined)[]): Promise<BodyMeshes> {
  const ids = [...new Set(bodies.flatMap((body) => (body?.shape?.kind === "mesh" && body.shape.mesh ? [body.shape.mesh] : [])))];
  const read = await Promise.all(ids.map((id) => preview(id).then((mesh): [string, Preview][] => [[id, mesh]], () => [])));
  return Object.fromEntries(read.flat());
}

function solidOf({ shape }: Body, meshes: BodyMeshes): BufferGeometry | null {
  if (shape.kind === "box") return new BoxGeometry(...shape.size_mm!);
  if (shape.kind === "cylinder") return upright(new CylinderGeometry(shape.radius_mm, shape.radius_mm, shape.height_mm, 32));
  if (shape.kind === "capsule") return upright(new CapsuleGeometry(shape.radius_mm, shape.length_mm, 6, 24));
  const mesh = meshes[shape.mesh ?? ""];
  return mesh ? new BufferGeometry().setAttribute("position", new Float32BufferAttribute(mesh.positions, 3)) : null;
}

export function bodyMesh(body: Body, look: Look, meshes: BodyMeshes = {}): Object3D {
  const geometry = solidOf(body, meshes);
  const paint = material(look);
  // A mesh has no normals of its corners, and may be open.
  if (body.shape.kind === "mesh") { paint.flatShading = true; paint.side = DoubleSide; }
  const made = geometry ? new Mesh(geometry, paint) : new Group();
  made.name = body.name;
  return place(made, matrixOf(body.owner_from_body));
}

/** Mesh of the capsule between two points. */
function capsule(from: Vector3, to: Vector3, radius: number, look: Look): Mesh {
  const along = to.clone().sub(from);
  const size = along.length();
  const made = new Mesh(upright(new CapsuleGeometry(radius, size, 6, 20)), material(look));
  const turn = new Quaternion().setFromUnitVectors(new Vector3(0, 0, 1), size > 0 ? along.divideScalar(size) : new Vector3(0, 0, 1));
  return place(made, new Matrix4().compose(from.clone().add(to).multiplyScalar(0.5), turn, new Vector3(1, 1, 1)));
}

export const FIXTURE_COLOUR = 0x8f6fa8;
const LINK_COLOURS = [0x5b6673, 0xb9c2cc, 0xd98a3d];

/** The arm as surfaces where they are known, else as capsules, moved by its joints. */
export class Arm {
  readonly object = new Group();
  readonly flange = new Group();
  private readonly links: Group[];

  constructor(private readonly robot: Robot, ghost?: Look, meshes: BodyMeshes = {}) {
    this.object.name = ghost ? "ghost" : "arm";
    this.links = Array.from({ length: 7 }, () => new Group());
    const lookOf = (link: number): Look => ghost ?? { colour: LINK_COLOURS[link === 0 ? 0 : 1 + (link % 2)]! };
    const surfaces = (robot.surfaces ?? []).filter(({ shape }) => shape.kind !== "mesh" || shape.mesh! in meshes);
    surfaces.forEach((body) => this.links[body.link]?.add(bodyMesh(body, lookOf(body.link), meshes)));
    robot.links.filter(({ link }) => !surfaces.some((body) => body.link === link)).forEach((link) => {
      const look = lookOf(link.link);
      this.links[link.link]?.add(capsule(new Vector3(...link.from_mm), new Vector3(...link.to_mm), link.radius_mm, look));
    });
    this.links[6]!.add(this.flange);
    this.object.add(...this.links);
  }

  /** Adds what moves with a link. */
  carry(link: number, object: Object3D): void {
    this.links[link]?.add(object);
  }

  pose(jointsDeg: readonly number[]): Matrix4 {
    const frames = linkFrames(this.robot, jointsDeg);
    frames.forEach((frame, i) => place(this.links[i]!, frame));
    return frames[6]!;
  }
}

/** The plate with marks that show how it turns. */
export function plateOf(table: Turntable): Group {
  const group = new Group();
  group.name = "plate";
  const radius = table.plate_diameter_mm / 2;
  const disc = upright(new CylinderGeometry(radius, radius, table.plate_thickness_mm, 72));
  disc.translate(0, 0, -table.plate_thickness_mm / 2);
  group.add(new Mesh(disc, material({ colour: 0x707b88 })));
  const points: number[] = [];
  for (let i = 0; i < 36; i += 1) {
    const [x, y] = [Math.cos((i * Math.PI) / 18), Math.sin((i * Math.PI) / 18)];
    const inner = i % 9 === 0 ? (i === 0 ? 0.55 : 0.8) : 0.93;
    points.push(inner * radius * x, inner * radius * y, 0.3, 0.99 * radius * x, 0.99 * radius * y, 0.3);
  }
  group.add(lines(points, 0xf2f4f7));
  return group;
}

export function lines(points: number[], colour: number | Rgb): LineSegments<BufferGeometry, LineBasicMaterial> {
  const geometry = new BufferGeometry().setAttribute("position", new Float32BufferAttribute(points, 3));
  const shade = Array.isArray(colour) ? new Color(`rgb(${colour.join(",")})`) : new Color(colour);
  return new LineSegments(geometry, new LineBasicMaterial({ color: shade }));
}

/** Where the rays through the corners of a device's image meet the planes of two depths, scanner frame. */
function corners(device: Device, depths: number[]): { centre: Vector3; at: Vector3[][] } {
  const frame = matrixOf(device.scanner_from_device);
  const centre = new Vector3().applyMatrix4(frame);
  const { width_px: w, height_px: h } = device;
  const rays = [[0, 0], [w, 0], [w, h], [0, h]].map(([u, v]) => {
    const y = (v! - device.cy) / device.fy;
    return new Vector3((u! - device.cx) / device.fx - device.skew * y, y, 1).applyMatrix4(frame).sub(centre);
  });
  return { centre, at: depths.map((depth) => rays.map((ray) => centre.clone().addScaledVector(ray, (depth - centre.z) / ray.z))) };
}

/** Frustums of the three devices over the working depth, scanner frame, and the planes of near, best and far. */
export function frustums(scanner: Scanner): Group {
  const group = new Group();
  group.name = "frustums";
  const { near, best, far } = scanner.depth_mm;
  for (const device of scanner.devices) {
    const { centre, at } = corners(device, [near, best, far]);
    const points: number[] = [];
    const join = (a: Vector3, b: Vector3): unknown => points.push(...a.toArray(), ...b.toArray());
    at[2]!.forEach((corner) => join(centre, corner));
    at.forEach((ring) => ring.forEach((corner, i) => join(corner, ring[(i + 1) % 4]!)));
    const made = lines(points, DEVICES[device.name]!);
    made.name = device.name;
    group.add(made);
    const [n, f] = [at[0]!, at[2]!];
    const sides = [0, 1, 2, 3].flatMap((i) => [n[i]!, f[i]!, f[(i + 1) % 4]!, n[i]!, f[(i + 1) % 4]!, n[(i + 1) % 4]!]);
    const geometry = new BufferGeometry().setAttribute("position",
      new Float32BufferAttribute(sides.flatMap((point) => point.toArray()), 3));
    const shade = new Color(`rgb(${DEVICES[device.name]!.join(",")})`);
    group.add(new Mesh(geometry, new MeshBasicMaterial({ color: shade, transparent: true, opacity: 0.03, side: DoubleSide,
      depthWrite: false })));
  }
  return group;
}

/** Viewpoints as pyramids that open towards the part, one instance each. */
export function viewGlyphs(poses: Pose[], size: number): InstancedMesh {
  const shape = new ConeGeometry(0.5 * size, 0.8 * size, 4, 1).rotateY(Math.PI / 4);
  // Point at the origin, opening along +z, where the scanner looks.
  shape.translate(0, -0.4 * size, 0).rotateX(-Math.PI / 2);
  const made = new InstancedMesh(shape, new MeshLambertMaterial({ transparent: true, opacity: 0.85 }), Math.max(1, poses.length));
  made.name = "viewpoints";
  made.count = poses.length;
  poses.forEach((pose, i) => made.setMatrixAt(i, matrixOf(pose)));
  made.frustumCulled = false;
  return made;
}

// The cell in three dimensions: arm, scanner, plate with the part, obstacles; posed by joints and table angle.
import { Box3, Group, Matrix4, Vector3 } from "three";
import { ask, type Body, type Cell, type Job, type Plan, type Pose, type Robot, type ScannerSpec, type Turntable } from "./api";
import { colourOfByte } from "./bytes";
import type { Clearance } from "./collide";
import type { Preview } from "./mesh";
import { matrixOf, turnZ } from "./poses";
import { length } from "./settings";
import { Arm, bodyMesh, bodyMeshes, FIXTURE_COLOUR, frustums, lines, place, plateOf, type BodyMeshes } from "./solids";
import { PartMesh, Stage } from "./stage";

const RAD = Math.PI / 180;

export interface CellModel { cell: Cell; robot: Robot; table: Turntable; scanner: ScannerSpec; meshes: BodyMeshes }

const named = <T>(room: string, given: string | T): Promise<T> | T =>
  (typeof given === "string" ? ask<T>(`/${room}/${encodeURIComponent(given)}`) : given);

export async function cellModelOf(job: Pick<Job, "cell">): Promise<CellModel> {
  const cell = await named<Cell>("cells", job.cell as string | Cell);
  const [robot, table, scanner] = await Promise.all([
    named<Robot>("robots", cell.robot), named<Turntable>("turntables", cell.turntable), named<ScannerSpec>("scanners", cell.scanner),
  ]);
  const bodies = [robot.surfaces, table.body, scanner.body, cell.mount, cell.obstacles, cell.cable].flatMap((given) => given ?? []);
  return { cell, robot, table, scanner, meshes: await bodyMeshes(bodies) };
}

const GHOST = { colour: 0x00a37a, opacity: 0.25 };

export class CellScene {
  /** Everything that it shows. */
  readonly root = new Group();
  private readonly arm: Arm;
  private ghost: Arm | null = null;
  private readonly onPlate = new Group();
  private readonly gap = new Group();
  private readonly partHolder = new Group();
  private readonly beams: Group | null;
  private readonly flangeFromScanner: Matrix4;
  /** Scanner in the base, as the joints have it. */
  readonly baseFromScanner = new Matrix4();

  constructor(readonly stage: Stage, private readonly model: CellModel, private readonly plan: Plan | null) {
    const { cell, robot, table, meshes } = model;
    this.flangeFromScanner = matrixOf(cell.flange_from_scanner);
    this.arm = new Arm(robot, undefined, meshes);
    this.beams = plan ? frustums(plan.scanner) : null;
    this.arm.flange.add(this.carried({ colour: 0x394350 }));
    (cell.mount ?? []).forEach((body) => this.arm.flange.add(bodyMesh(body, { colour: 0x7d8793 }, meshes)));
    this.onPlate.add(plateOf(table), this.partHolder);
    const still = place(new Group(), matrixOf(cell.base_from_table));
    (table.body ?? []).forEach((body) => still.add(bodyMesh(body, { colour: 0x8c96a1 }, meshes)));
    const obstacles = new Group();
    obstacles.name = "obstacles";
    (cell.obstacles ?? []).forEach((body) => obstacles.add(bodyMesh(body, { colour: 0xa08f7a }, meshes)));
    (cell.cable ?? []).forEach((body) => this.arm.carry(body.link, bodyMesh(body, { colour: 0x2f3640 }, meshes)));
    stage.scene.add(this.root.add(this.gap, this.arm.object, this.onPlate, still, obstacles, floorLines(cell.floor_mm ?? null)));
    this.pose(cell.home_deg);
  }

  private carried(look: { colour: number; opacity?: number }): Group {
    const group = place(new Group(), this.flangeFromScanner);
    group.name = "scanner";
    (this.model.scanner.body ?? []).forEach((body: Body) => group.add(bodyMesh(body, look, this.model.meshes)));
    if (this.beams && !look.opacity) group.add(this.beams);
    return group;
  }

  /** Takes it off the stage. */
  dispose(): void {
    this.stage.clear(this.root);
    this.stage.scene.remove(this.root);
  }

  showPart(mesh: Preview, bytes: Uint8Array | null, fixture: Preview | null, tableFromPart: Pose): void {
    this.stage.clear(this.partHolder);
    const part = new PartMesh(mesh);
    if (bytes) part.paint((face) => colourOfByte(bytes[face]!));
    const held = fixture ? [bodyMesh({ name: "fixture", shape: { kind: "mesh", mesh: "fixture" } }, { colour: FIXTURE_COLOUR }, { fixture })] : [];
    this.partHolder.add(place(new Group().add(part.mesh, ...held), matrixOf(tableFromPart)));
    this.stage.invalidate();
  }

  /** Joints 1 to 6 and the table angle, degrees. */
  pose(configurationDeg: readonly number[]): void {
    const flange = this.arm.pose(configurationDeg);
    this.baseFromScanner.multiplyMatrices(flange, this.flangeFromScanner);
    place(this.onPlate, matrixOf(this.model.cell.base_from_table).multiply(turnZ((configurationDeg[6] ?? 0) * RAD)));
    this.stage.invalidate();
  }

  showGhost(configurationDeg: readonly number[] | null): void {
    if (configurationDeg && !this.ghost) {
      this.ghost = new Arm(this.model.robot, GHOST, this.model.meshes);
      this.ghost.flange.add(this.carried(GHOST));
      this.root.add(this.ghost.object);
    }
    if (this.ghost) this.ghost.object.visible = configurationDeg !== null;
    if (configurationDeg) this.ghost!.pose(configurationDeg);
    this.stage.invalidate();
  }

  /** The line between the two bodies that are nearest to each other. */
  showGap(clearance: Clearance | null, isTight: boolean): void {
    this.stage.clear(this.gap);
    this.gap.name = "gap";
    if (clearance) {
      const drawn = lines([...clearance.from, ...clearance.to], isTight ? 0xd55e00 : 0x0072b2);
      drawn.material.depthTest = false;
      drawn.renderOrder = 2;
      this.gap.add(drawn);
    }
    const middle = clearance && new Vector3(...clearance.from).add(new Vector3(...clearance.to)).multiplyScalar(0.5);
    this.stage.setLabels(middle ? [{ at: middle, text: length(clearance!.mm) }] : []);
  }

  showBeams(isShown: boolean): void {
    if (this.beams) this.beams.visible = isShown;
    this.stage.invalidate();
  }

  box(): Box3 {
    // Frustums reach far past the part, and would make everything else small.
    const beams = this.beams?.parent;
    if (this.beams && beams) beams.remove(this.beams);
    const box = new Box3().setFromObject(this.arm.object).union(new Box3().setFromObject(this.onPlate));
    if (this.beams && beams) beams.add(this.beams);
    return box;
  }

  /** Distance of the scanner from where a view was planned, mm and degrees, at a configuration. */
  offPlan(viewpoint: number, configurationDeg: readonly number[]): { mm: number; deg: number } | null {
    const view = this.plan?.viewpoints.find((view) => view.id === viewpoint);
    if (!view || !this.plan?.cell) return null;
    const setup = this.plan.setups?.find((setup) => setup.viewpoints.includes(viewpoint));
    const planned = matrixOf(this.model.cell.base_from_table).multiply(turnZ((configurationDeg[6] ?? 0) * RAD))
      .multiply(matrixOf(setup?.table_from_part ?? this.plan.cell.table_from_part)).multiply(matrixOf(view.part_from_scanner));
    const [a, b] = [new Vector3().setFromMatrixPosition(planned), new Vector3().setFromMatrixPosition(this.baseFromScanner)];
    const axis = (matrix: Matrix4): Vector3 => new Vector3().setFromMatrixColumn(matrix, 2);
    return { mm: a.distanceTo(b), deg: axis(planned).angleTo(axis(this.baseFromScanner)) / RAD };
  }
}

function floorLines(floor: number | null): Group {
  const group = new Group();
  if (floor === null) return group;
  const points: number[] = [];
  for (let i = -6; i <= 6; i += 1) points.push(-1200, 200 * i, floor, 1200, 200 * i, floor, 200 * i, -1200, floor, 200 * i, 1200, floor);
  group.add(lines(points, 0x9aa4b0));
  group.name = "floor";
  return group;
}

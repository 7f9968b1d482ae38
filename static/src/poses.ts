// Rigid motions as three.js matrices, from the shapes of the API, and the arm's forward kinematics.
import { Matrix4, Quaternion, Vector3 } from "three";
import type { GivenPose, Pose, Robot } from "./api";

const RAD = Math.PI / 180;
const UNIT = new Vector3(1, 1, 1);

export const shift = (x: number, y: number, z: number): Matrix4 => new Matrix4().makeTranslation(x, y, z);
export const turnX = (rad: number): Matrix4 => new Matrix4().makeRotationX(rad);
export const turnY = (rad: number): Matrix4 => new Matrix4().makeRotationY(rad);
export const turnZ = (rad: number): Matrix4 => new Matrix4().makeRotationZ(rad);
export const product = (...factors: Matrix4[]): Matrix4 => factors.reduce((left, right) => left.clone().multiply(right));

export function matrixOf(pose: GivenPose | null | undefined): Matrix4 {
  if (!pose) return new Matrix4();
  const place = new Vector3(...pose.translation_mm);
  if ("quaternion_xyzw" in pose) return new Matrix4().compose(place, new Quaternion(...pose.quaternion_xyzw), UNIT);
  // Turns about the fixed axes X, Y, Z in this order (URDF).
  const [roll, pitch, yaw] = pose.rpy_deg.map((deg) => deg * RAD) as [number, number, number];
  return product(shift(place.x, place.y, place.z), turnZ(yaw), turnY(pitch), turnX(roll));
}

export function poseOf(matrix: Matrix4): Pose {
  const [place, turn, scale] = [new Vector3(), new Quaternion(), new Vector3()];
  matrix.decompose(place, turn, scale);
  return { translation_mm: place.toArray(), quaternion_xyzw: turn.toArray() as Pose["quaternion_xyzw"] };
}

interface Opw {
  a1_mm: number; a2_mm: number; b_mm: number; c1_mm: number; c2_mm: number; c3_mm: number; c4_mm: number;
  sign_corrections: number[]; offsets_deg: number[]; joint_3_from_ground?: boolean;
}

/** Ortho-parallel arm with a spherical wrist (Brandstötter, Angerer, Hofbaur 2014), frames as `src/cell/kinematics/opw.rs`. */
function opwFrames(arm: Opw, joints: number[]): Matrix4[] {
  const q = [...joints];
  if (arm.joint_3_from_ground) q[2]! -= arm.sign_corrections[1]! * arm.sign_corrections[2]! * q[1]!;
  const theta = q.map((rad, i) => arm.sign_corrections[i]! * rad - arm.offsets_deg[i]! * RAD) as number[];
  const one = product(shift(0, 0, arm.c1_mm), turnZ(theta[0]!));
  const two = product(one, shift(arm.a1_mm, arm.b_mm, 0), turnY(theta[1]!));
  const three = product(two, shift(0, 0, arm.c2_mm), turnY(theta[2]!));
  const four = product(three, shift(arm.a2_mm, 0, arm.c3_mm), turnZ(theta[3]!));
  const five = product(four, turnY(theta[4]!));
  return [new Matrix4(), one, two, three, four, five, product(five, turnZ(theta[5]!), shift(0, 0, arm.c4_mm))];
}

interface Ur { d1_mm: number; a2_mm: number; a3_mm: number; d4_mm: number; d5_mm: number; d6_mm: number }

/** Arm with three parallel axes, Denavit–Hartenberg rows of its maker, frames as `src/cell/kinematics/ur.rs`. */
function urFrames(arm: Ur, theta: number[]): Matrix4[] {
  const one = product(shift(0, 0, arm.d1_mm), turnZ(theta[0]!));
  const two = product(one, turnX(Math.PI / 2), turnZ(theta[1]!));
  const three = product(two, shift(arm.a2_mm, 0, 0), turnZ(theta[2]!));
  const four = product(three, shift(arm.a3_mm, 0, 0), turnZ(theta[3]!));
  const five = product(four, shift(0, 0, arm.d4_mm), turnX(Math.PI / 2), turnZ(theta[4]!));
  const six = product(five, shift(0, 0, arm.d5_mm), turnX(-Math.PI / 2), turnZ(theta[5]!));
  return [new Matrix4(), one, two, three, four, five, product(six, shift(0, 0, arm.d6_mm))];
}

interface Chain { joints: { axis: [number, number, number]; origin: Pose }[]; flange: Pose }

function chainFrames(arm: Chain, theta: number[]): Matrix4[] {
  const frames = [new Matrix4()];
  arm.joints.forEach((joint, i) => {
    const turn = new Matrix4().makeRotationAxis(new Vector3(...joint.axis).normalize(), theta[i]!);
    frames.push(product(frames[i]!, matrixOf(joint.origin), turn));
  });
  frames[6] = product(frames[6]!, matrixOf(arm.flange));
  return frames;
}

/** Frames of the foot, joints 1 to 5 and the flange, in the arm's base. */
export function linkFrames(robot: Robot, jointsDeg: readonly number[]): Matrix4[] {
  const joints = jointsDeg.slice(0, 6).map((deg) => deg * RAD);
  const arm = robot.kinematics as unknown;
  if (robot.kinematics.kind === "opw") return opwFrames(arm as Opw, joints);
  return robot.kinematics.kind === "ur" ? urFrames(arm as Ur, joints) : chainFrames(arm as Chain, joints);
}

/** Pose of the scanner in the part, from the chain of a cell. */
export function partFromScanner(
  cell: { base_from_table: Pose; table_from_part: Pose; flange_from_scanner: Pose }, robot: Robot, jointsDeg: readonly number[],
  tableDeg: number,
): Matrix4 {
  const baseFromPart = product(matrixOf(cell.base_from_table), turnZ(tableDeg * RAD), matrixOf(cell.table_from_part));
  return product(baseFromPart.invert(), linkFrames(robot, jointsDeg)[6]!, matrixOf(cell.flange_from_scanner));
}

/** The board in a camera, as calibration tools print it. */
export interface BoardPose { rotation_rows: [number, number, number][]; translation_mm: [number, number, number] }

function boardMatrix({ rotation_rows: [a, b, c], translation_mm: [x, y, z] }: BoardPose): Matrix4 {
  const printed = new Matrix4().set(...a!, x, ...b!, y, ...c!, z, 0, 0, 0, 1);
  // Printed digits leave the rows a little off a rotation.
  return new Matrix4().compose(new Vector3(x, y, z), new Quaternion().setFromRotationMatrix(printed).normalize(), UNIT);
}

/** Cameras and board in the scanner frame, from one board seen by both cameras: origin in the middle of the baseline, x along it, z
 * the mean optical axis made perpendicular to x (`left_from_scanner` in `src/cell/scanner/spec.rs`). */
export function rigOf(boards: { left: BoardPose; right: BoardPose }): { left: Matrix4; right: Matrix4; board: Matrix4 } {
  const leftFromBoard = boardMatrix(boards.left);
  const leftFromRight = leftFromBoard.clone().multiply(boardMatrix(boards.right).invert());
  const baseline = new Vector3().setFromMatrixPosition(leftFromRight);
  const x = baseline.clone().normalize();
  const axes = new Vector3(0, 0, 1).add(new Vector3().setFromMatrixColumn(leftFromRight, 2));
  const z = axes.addScaledVector(x, -x.dot(axes)).normalize();
  const leftFromScanner = new Matrix4().makeBasis(x, new Vector3().crossVectors(z, x), z).setPosition(baseline.multiplyScalar(0.5));
  const left = leftFromScanner.invert();
  return { left, right: left.clone().multiply(leftFromRight), board: left.clone().multiply(leftFromBoard) };
}

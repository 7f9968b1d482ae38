// What the plan view draws: part by colour mode, viewpoints, frustums, marked faces, chosen spot, section and measure.
import {
  Box3, BufferAttribute, BufferGeometry, CircleGeometry, Color, EdgesGeometry, Group, type InstancedMesh, Matrix4, Mesh,
  MeshBasicMaterial, type Object3D, Plane, SphereGeometry, Vector3,
} from "three";
import { colourOf, isGrade, meaningOf } from "./bytes";
import type { Preview } from "./mesh";
import { causeColour, MARKED, MISSED, NOT_ASKED, BELOW, onScale, PLAIN, viewColour, type Rgb } from "./palette";
import type { EditedView, Model } from "./planmodel";
import { matrixOf } from "./poses";
import { FIXTURE_COLOUR, frustums, lines, place, viewGlyphs } from "./solids";
import { PartMesh, Stage, STANDARD_VIEWS, type Label, type PointerPick } from "./stage";
import type { Scores } from "./worker";

export type Colouring = "grade" | "count" | "incidence" | "cause";
export interface Threshold { grade: number; count: number; incidence: number }
export const OPEN: Threshold = { grade: 4, count: 1, incidence: 90 };

const LETTERS = "ABCD";

export function scaleOf(scores: Scores): number {
  return scores.counts.reduce((max, count) => Math.max(max, count), 1);
}

/** Colour of a face in a mode; scores are there for the modes that need them. */
export function painter(model: Model, mode: Colouring, scores: Scores | null, threshold: Threshold): (face: number) => Rgb {
  const { bytes } = model;
  const byByte = (colour: (meaning: string) => Rgb): ((face: number) => Rgb) => {
    const colours = Array.from({ length: 256 }, (_, byte) => colour(meaningOf(byte)));
    return (face) => colours[bytes[face]!]!;
  };
  if (mode === "cause") return byByte((meaning) => (isGrade(meaning) ? PLAIN : colourOf(meaning)));
  if (mode === "grade" || !scores) {
    return byByte((meaning) => {
      if (!isGrade(meaning)) return meaning === "not_asked" ? NOT_ASKED : MISSED;
      return LETTERS.indexOf(meaning) < threshold.grade ? colourOf(meaning) : BELOW;
    });
  }
  const isAsked = (face: number): boolean => meaningOf(bytes[face]!) !== "not_asked";
  if (mode === "count") {
    const most = scaleOf(scores);
    return (face) => {
      const count = scores.counts[face]!;
      if (count === 0) return isAsked(face) ? MISSED : NOT_ASKED;
      return count >= threshold.count ? onScale(count / most) : BELOW;
    };
  }
  return (face) => {
    const deg = scores.incidences[face]!;
    if (deg === 255) return isAsked(face) ? MISSED : NOT_ASKED;
    return deg <= threshold.incidence ? onScale(1 - deg / 90) : BELOW;
  };
}

export type SectionAxis = "off" | "x" | "y" | "z";
const AXES: Record<string, [number, number, number]> = { x: [-1, 0, 0], y: [0, -1, 0], z: [0, 0, -1] };

export class PlanScene {
  readonly part: PartMesh;
  /** What is given in the part's own coordinates, as the part lies. */
  private readonly root = new Group();
  private readonly overlay = new Group();
  private readonly frustum = new Group();
  private readonly pins = new Group();
  private readonly plate = new Group();
  private glyphs: InstancedMesh | null = null;
  private shownViews: EditedView[] = [];
  private framed: number | null = null;
  private readonly size: number;
  /** Box of the part as it lies. */
  private box: Box3;
  marked = new Set<number>();
  section: { axis: SectionAxis; at: number } = { axis: "off", at: 0 };

  constructor(readonly stage: Stage, private readonly model: Model, shownFromPart: Matrix4 | null) {
    this.part = new PartMesh(model.mesh);
    this.box = this.part.box;
    this.size = this.part.box.getSize(new Vector3()).length();
    this.root.name = "lying";
    this.overlay.name = "overlay";
    this.frustum.name = "frustum";
    this.pins.name = "pins";
    this.plate.name = "plate";
    this.root.add(this.part.mesh, this.overlay, this.frustum, this.pins);
    if (model.fixture) this.root.add(edgesOf(model.fixture));
    stage.scene.add(this.root, this.plate);
    this.lay(shownFromPart);
  }

  /** Lays the part on the plate, or, with no pose, shows it as its file has it. */
  lay(shownFromPart: Matrix4 | null): void {
    place(this.root, shownFromPart ?? new Matrix4()).updateMatrixWorld(true);
    this.box = lyingBox(this.model, shownFromPart);
    this.stage.clear(this.plate);
    if (shownFromPart) this.plate.add(...plateDisc(this.model.plateRadius));
    this.cut(this.section.axis, this.section.at);
    this.label();
    this.stage.look(this.box, STANDARD_VIEWS.iso!);
  }

  /** A ray in the part's coordinates. */
  inPart(pick: PointerPick): PointerPick {
    const partFromShown = this.root.matrix.clone().invert();
    return { ...pick, origin: new Vector3(...pick.origin).applyMatrix4(partFromShown).toArray(),
      direction: new Vector3(...pick.direction).transformDirection(partFromShown).toArray() };
  }

  paint(colour: (face: number) => Rgb): void {
    this.part.paint(this.marked.size > 0 ? (face) => (this.marked.has(face) ? MARKED : colour(face)) : colour);
    this.stage.invalidate();
  }

  /** Viewpoints, with their numbers. */
  showViews(views: EditedView[], chosen: number | null, nameOf: (view: EditedView) => string, onChoose: (id: number) => void): void {
    this.stage.clear(this.overlay);
    this.shownViews = views;
    this.glyphs = null;
    this.labels = views.map((view) => ({ at: new Vector3(...view.pose.translation_mm), text: String(view.id), more: nameOf(view), key: view.id,
      className: view.id === chosen ? "chosen" : view.isUsed ? "" : "unused", onClick: () => onChoose(view.id) }));
    if (views.length > 0) {
      this.glyphs = viewGlyphs(views.map((view) => view.pose), Math.max(24, this.size / 9));
      views.forEach((view, i) => this.glyphs!.setColorAt(i, new Color(`rgb(${viewColour(view, view.id === chosen).join()})`)));
      this.overlay.add(this.glyphs);
    }
    this.label();
  }

  private labels: Label[] = [];
  private pinLabels: Label[] = [];
  private label(): void {
    this.stage.setLabels([...this.labels, ...this.pinLabels].map((label) => ({ ...label, at: label.at.clone().applyMatrix4(this.root.matrix) })));
  }

  /** View that a ray meets before the part. */
  viewAt(pick: PointerPick, before: number): number | null {
    const hit = this.glyphs && Stage.hit(pick, [this.glyphs]);
    return hit && hit.distance < before ? this.shownViews[hit.instance]?.id ?? null : null;
  }

  private shownAt = ({ pose }: EditedView): Vector3 => new Vector3(...pose.translation_mm).applyMatrix4(this.root.matrix);

  showFrustum(view: EditedView | null): void {
    this.stage.clear(this.frustum);
    if (view) this.frustum.add(place(frustums(this.model.plan.scanner), matrixOf(view.pose)));
    // The camera goes back far enough to show from where the chosen view looks; while that is moved by hand it stays.
    if (view && view.id !== this.framed) this.stage.fit(this.box.clone().expandByPoint(this.shownAt(view)));
    this.framed = view?.id ?? null;
    this.stage.invalidate();
  }

  /** Box that holds part and viewpoints. */
  wholeBox(): Box3 {
    const box = this.box.clone();
    this.shownViews.forEach((view) => box.expandByPoint(this.shownAt(view)));
    return box;
  }

  /** Turns to a spot: along its normal, or as near to that as nothing of the part lies before it. The camera stays where the spot is
   *  seen already. `isMet` says if a ray from a place to the spot meets it first, all in the part's coordinates; `isWanted`, if it is still chosen. */
  async reveal({ point, normal }: { point: number[]; normal: number[] }, isMet: (from: number[]) => Promise<boolean>, isWanted: () => boolean): Promise<void> {
    const [at, outward, partFromShown] = [new Vector3().fromArray(point), new Vector3().fromArray(normal), this.root.matrix.clone().invert()];
    const isSeen = async (eye: Vector3): Promise<boolean> => {
      const from = eye.applyMatrix4(partFromShown);
      return from.clone().sub(at).normalize().dot(outward) > FACING_COS && isMet(from.toArray());
    };
    if (this.stage.shows(at.clone().applyMatrix4(this.root.matrix)) && await isSeen(this.stage.eye())) return;
    const ways = around(outward).map((way) => way.transformDirection(this.root.matrix).toArray());
    let best = ways[0]!;
    for (const way of ways) if (await isSeen(this.stage.eye(this.box, way))) { best = way; break; }
    if (isWanted()) this.stage.look(this.box, best);
  }

  private ball(at: Vector3, colour: number): Mesh {
    const made = new Mesh(new SphereGeometry(this.size / 120, 16, 12), new MeshBasicMaterial({ color: colour, depthTest: false, transparent: true }));
    made.position.copy(at);
    made.renderOrder = 2;
    return made;
  }

  /** Chosen spot with its normal, a measured distance, a box being drawn. */
  showPins(spot: { point: number[]; normal: number[] } | null, measure: number[][], distance: string, box: { min: number[]; max: number[] } | null): void {
    this.stage.clear(this.pins);
    this.pinLabels = [];
    if (spot) {
      const at = new Vector3().fromArray(spot.point);
      const tip = at.clone().addScaledVector(new Vector3().fromArray(spot.normal), this.size / 6);
      this.pins.add(this.ball(at, 0xe69f00), lines([...at.toArray(), ...tip.toArray()], 0xe69f00));
    }
    measure.forEach((point) => this.pins.add(this.ball(new Vector3().fromArray(point), 0x00a37a)));
    if (measure.length === 2) {
      const [a, b] = measure.map((point) => new Vector3().fromArray(point)) as [Vector3, Vector3];
      const made = lines([...a.toArray(), ...b.toArray()], 0x00a37a);
      made.renderOrder = 2;
      (made.material as { depthTest: boolean }).depthTest = false;
      this.pins.add(made);
      this.pinLabels.push({ at: a.clone().add(b).multiplyScalar(0.5), text: distance, className: "measure" });
    }
    if (box) this.pins.add(lines(boxLines(box.min, box.max), 0x00a37a));
    this.label();
  }

  cut(axis: SectionAxis, share: number): void {
    this.section = { axis, at: share };
    this.part.cut(this.sectionPlane());
    this.stage.invalidate();
  }

  /** Section plane as it is drawn; what lies behind it is shown. */
  private sectionPlane(): Plane | null {
    const normal = AXES[this.section.axis];
    return normal ? new Plane(new Vector3(...normal), sectionAt(this.box, this.section.axis, this.section.at)) : null;
  }

  /** Normal and constant of the section plane in the part's coordinates. */
  plane(): number[] | null {
    const plane = this.sectionPlane()?.applyMatrix4(this.root.matrix.clone().invert());
    return plane ? [...plane.normal.toArray(), plane.constant] : null;
  }
}

/** Box of the part as it lies, or, with no pose, as its file has it. */
export const lyingBox = ({ mesh: { min, max } }: Model, shownFromPart: Matrix4 | null): Box3 =>
  new Box3(new Vector3(...min), new Vector3(...max)).applyMatrix4(shownFromPart ?? new Matrix4());

/** Where a section plane is along its axis, mm, of its share of a box. */
export const sectionAt = ({ min, max }: Box3, axis: SectionAxis, share: number): number =>
  (axis === "off" ? 0 : min[axis] + (max[axis] - min[axis]) * share);

/** Cosine to its normal up to which a face is seen from a place: nearly edge-on it is but a line. */
const FACING_COS = 0.1;

/** Directions around one, itself first, then ever farther from it. */
function around(direction: Vector3): Vector3[] {
  const across = new Vector3().crossVectors(direction, Math.abs(direction.z) < 0.9 ? new Vector3(0, 0, 1) : new Vector3(1, 0, 0)).normalize();
  const tilted = [20, 40, 60, 75].flatMap((tilt) => Array.from({ length: 8 }, (_, i) =>
    direction.clone().applyAxisAngle(across, (tilt * Math.PI) / 180).applyAxisAngle(direction, (i * Math.PI) / 4)));
  return [direction.clone(), ...tilted];
}

/** Surface and rim of the plate. From below the part is seen through it. */
function plateDisc(radius: number): Object3D[] {
  const disc = new Mesh(new CircleGeometry(radius, 72), new MeshBasicMaterial({ color: 0x8c96a1, transparent: true, opacity: 0.4, depthWrite: false }));
  // Beneath the face on which the part lies.
  disc.position.z = -0.2;
  const at = (i: number): number[] => [radius * Math.cos((i * Math.PI) / 36), radius * Math.sin((i * Math.PI) / 36), -0.2];
  return [disc, lines(Array.from({ length: 72 }, (_, i) => [...at(i), ...at(i + 1)]).flat(), 0x5b6673)];
}

const SHARP_DEG = 15;

/** Edges of a fixture: a surface would hide the part, or tint its colours. */
function edgesOf({ positions }: Preview): Object3D {
  const surface = new BufferGeometry().setAttribute("position", new BufferAttribute(positions, 3));
  const made = lines([...new EdgesGeometry(surface, SHARP_DEG).getAttribute("position").array], FIXTURE_COLOUR);
  made.name = "fixture";
  return made;
}

function boxLines(min: number[], max: number[]): number[] {
  const corner = (i: number): number[] => [0, 1, 2].map((axis) => ((i >> axis) & 1 ? max[axis]! : min[axis]!));
  const points: number[] = [];
  for (let a = 0; a < 8; a += 1) {
    for (let axis = 0; axis < 3; axis += 1) if (!((a >> axis) & 1)) points.push(...corner(a), ...corner(a | (1 << axis)));
  }
  return points;
}

/** Legend of a mode: colour, name, area of the preview. */
export interface LegendRow { colour: Rgb; name: string; area: number; key: string }

export function legendOf(model: Model, mode: Colouring, scores: Scores | null, areas: Map<string, number>, names: {
  causes: Record<string, string>; grades: Record<string, string>; missed: string; measured: string; notAsked: string; views: (n: number) => string;
}): LegendRow[] {
  const row = (colour: Rgb, name: string, area: number, key: string): LegendRow => ({ colour, name, area, key });
  const missedArea = [...areas].filter(([key]) => !isGrade(key) && key !== "not_asked").reduce((sum, [, area]) => sum + area, 0);
  const notAsked = areas.get("not_asked") ?? 0;
  const rest = [row(MISSED, names.missed, missedArea, "missed"), row(NOT_ASKED, names.notAsked, notAsked, "not_asked")];
  if (mode === "grade") return [...[...LETTERS].map((grade) => row(colourOf(grade), names.grades[grade]!, areas.get(grade) ?? 0, grade)), ...rest].filter(({ area }) => area > 0);
  if (mode === "cause") {
    const measured = [...LETTERS].reduce((sum, grade) => sum + (areas.get(grade) ?? 0), 0);
    const causes = [...areas].filter(([key]) => !isGrade(key) && key !== "not_asked").sort(([, a], [, b]) => b - a);
    return [row(PLAIN, names.measured, measured, "measured"), ...causes.map(([key, area]) => row(causeColour(key), names.causes[key] ?? key, area, key)), rest[1]!]
      .filter(({ area }) => area > 0);
  }
  if (!scores) return [];
  return [...scored(model, mode, scores, row, names.views), row(MISSED, names.missed, scores.total - scores.measured - notAsked, "missed"), rest[1]!].filter(({ area }) => area > 0);
}

function scored(
  { mesh }: Model, mode: Colouring, scores: Scores, row: (colour: Rgb, name: string, area: number, key: string) => LegendRow, views: (n: number) => string,
): LegendRow[] {
  const sum = (isIn: (face: number) => boolean): number => mesh.areas.reduce((total, area, face) => total + (isIn(face) ? area : 0), 0);
  if (mode === "count") {
    const most = scaleOf(scores);
    const steps = [...new Set(most <= 5 ? Array.from({ length: most }, (_, i) => i + 1) : [1, 2, 3, 5, Math.round(most / 2), most])].filter((n) => n <= most).sort((a, b) => a - b);
    return steps.map((from, i) => {
      const to = (steps[i + 1] ?? most + 1) - 1;
      return row(onScale(from / most), from === to ? views(from) : `${from} – ${views(to)}`, sum((face) => scores.counts[face]! >= from && scores.counts[face]! <= to), `count${from}`);
    });
  }
  const steps = [0, 15, 30, 45, 60, 75];
  return steps.map((from) => row(onScale(1 - (from + 7) / 90), `${from}° – ${from + 15}°`,
    sum((face) => scores.incidences[face]! >= from && scores.incidences[face]! < from + 15), `deg${from}`));
}

// The inspected part in 3D: losses by cause, planned against measured, deviation; what a face is; and two rounds side by side.
import { useSignal } from "@preact/signals";
import { useEffect, useMemo, useRef, useState } from "preact/hooks";
import { BufferAttribute, BufferGeometry, Group, Mesh, MeshBasicMaterial, Points, PointsMaterial, SphereGeometry, Vector3 } from "three";
import type { Inspection, InspectionJob, Vector } from "./api";
import { cloudOf, matchOf, needsCloud, painterOf, type Cloud, type FaceMap, type MapKind } from "./facemap";
import { hasDeviation } from "./located";
import { Tracer } from "./mesh";
import { BELOW, css, diverging, lossColour, MATCH, LOST, UNASKED, WHOLE, UNMEASURED, type Rgb } from "./palette";
import { area, fine, lengthUnit, percent, point as shownPoint, unit } from "./settings";
import { linear, PartMesh, Stage, STANDARD_VIEWS } from "./stage";
import { text } from "./text";
import { Select, Slider, Swatch, useLoaded } from "./widgets";
import { View3d } from "./view3d";

const words = text.inspections;

export interface LegendRow { key: string; colour: Rgb; name: string; area: number }
/** A place that a list beside the map names. */
export interface Pin { at: Vector; size: number }

const LAMP = [0.3, -0.45, 0.84];

class MapScene {
  readonly part: PartMesh;
  private readonly cloud = new Group();
  private readonly pins = new Group();

  constructor(readonly stage: Stage, readonly map: FaceMap) {
    this.part = new PartMesh(map.mesh);
    this.cloud.name = "cloud";
    this.pins.name = "pins";
    // Samples lie on the faces; these step back by a hair.
    Object.assign(this.part.mesh.material, { polygonOffset: true, polygonOffsetFactor: 2, polygonOffsetUnits: 2 });
    stage.scene.add(this.part.mesh, this.cloud, this.pins);
    stage.look(this.part.box, STANDARD_VIEWS.iso!);
  }

  paint(colour: (face: number) => Rgb): void {
    this.part.paint(colour);
    this.stage.invalidate();
  }

  /** Draws the samples in the colours of their deviation; `null` draws the faces alone. */
  showCloud(cloud: Cloud | null, limit: number, areaOfSample: number): void {
    this.stage.clear(this.cloud);
    if (cloud) {
      const colours = new Uint8Array(3 * cloud.count);
      cloud.deviations.forEach((value, i) => {
        // Points take no light; a lamp from above keeps the shape readable.
        const lit = 0.8 + 0.2 * LAMP.reduce((sum, part, axis) => sum + part * cloud.normals[3 * i + axis]!, 0);
        diverging(value / limit).forEach((channel, at) => { colours[3 * i + at] = lit * linear(channel); });
      });
      const geometry = new BufferGeometry();
      geometry.setAttribute("position", new BufferAttribute(cloud.positions, 3));
      geometry.setAttribute("color", new BufferAttribute(colours, 3, true));
      // The size of points is that at an opening of 90°.
      const size = (1.8 * Math.sqrt(areaOfSample)) / Math.tan((this.stage.camera.fov * Math.PI) / 360);
      this.cloud.add(new Points(geometry, new PointsMaterial({ vertexColors: true, size })));
    }
    this.stage.invalidate();
  }

  /** Marks a place, and goes there if it came from a list. */
  showPin(at: Vector | null, size: number | null): void {
    this.stage.clear(this.pins);
    if (at) {
      const whole = this.part.box.getSize(new Vector3()).length();
      const ball = new Mesh(new SphereGeometry(whole / 120, 16, 12), new MeshBasicMaterial({ color: 0x111111, depthTest: false, transparent: true }));
      const core = new Mesh(new SphereGeometry(whole / 190, 16, 12), new MeshBasicMaterial({ color: 0xffffff, depthTest: false, transparent: true }));
      ball.renderOrder = 2;
      core.renderOrder = 3;
      ball.position.set(...at);
      core.position.set(...at);
      this.pins.add(ball, core);
      if (size !== null) this.stage.look(this.part.box, outward(this.map, at, size));
    }
    this.stage.invalidate();
  }
}

/** Direction from which a place on the part is looked at: the normal of the surface around it. */
function outward({ mesh }: FaceMap, at: Vector, size: number): Vector {
  const sum = [0, 0, 0];
  const [nearest, around] = [{ away: Infinity, normal: [0, 0, 1] as number[] }, Math.max(0.5, size / 4) ** 2];
  for (let face = 0; face < mesh.faces; face += 1) {
    const p = mesh.positions.subarray(9 * face, 9 * face + 9) as unknown as number[];
    const away = [0, 1, 2].reduce((squares, i) => squares + ((p[i]! + p[i + 3]! + p[i + 6]!) / 3 - at[i]!) ** 2, 0);
    if (away > around && away >= nearest.away) continue;
    const [ax, ay, az] = [p[3]! - p[0]!, p[4]! - p[1]!, p[5]! - p[2]!];
    const [bx, by, bz] = [p[6]! - p[0]!, p[7]! - p[1]!, p[8]! - p[2]!];
    const normal = [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx];
    if (away <= around) normal.forEach((value, i) => { sum[i]! += value; });
    if (away < nearest.away) Object.assign(nearest, { away, normal });
  }
  const found = Math.hypot(...sum) > 1e-6 ? sum : nearest.normal;
  // From straight above or below there is no way up.
  const size1 = Math.hypot(...found) || 1;
  const [x, y, z] = found.map((value) => value / size1) as Vector;
  return Math.hypot(x, y) < 0.05 ? [0.05, -0.3, Math.sign(z) || 1] : [x, y, z + 0.25];
}

export const Legend = ({ rows, whole, note }: { rows: LegendRow[]; whole: number; note: string }) => (
  <div class="legend" tabIndex={0} role="group" aria-label={text.plan.legend}>
    <table aria-label={text.plan.legend}><tbody>{rows.map((row) => (
      <tr key={row.key} data-key={row.key}><th scope="row"><Swatch colour={css(row.colour)} /> {row.name}</th>
        <td class="number">{area(row.area)}</td><td class="number">{percent(row.area / whole, 2)}</td></tr>
    ))}</tbody></table>
    <p class="soft">{note}</p>
  </div>
);

const STEPS = 7;

/** Legend of a map; areas of losses and coverage are the server's, those of deviation by what is drawn: the samples, or the faces. */
function legendOf(map: FaceMap, kind: MapKind, result: Inspection, limit: number, cloud: Cloud | null): LegendRow[] {
  const { coverage, losses } = result;
  const asked = coverage.asked_area_mm2;
  const row = (key: string, colour: Rgb, name: string, mm2: number): LegendRow => ({ key, colour, name, area: mm2 });
  if (kind === "coverage") return (["both", "lost", "gained", "neither"] as const).map((key) => row(key, MATCH[key]!, words.match[key]!, asked * coverage[`${key}_of_asked`]));
  if (kind === "losses") {
    return [row("measured", WHOLE, text.plan.measured, asked * coverage.measured_of_asked), row("neither", BELOW, words.match.neither!, asked * coverage.neither_of_asked),
      ...losses.map((loss) => row(loss.cause, lossColour(loss.cause), words.losses[loss.cause] ?? loss.cause, loss.area_mm2))];
  }
  const areas = new Float64Array(STEPS + 1);
  const add = (deviation: number, mm2: number): void => { areas[Math.max(0, Math.min(STEPS - 1, Math.floor((deviation / limit + 1) * STEPS / 2)))]! += mm2; };
  cloud?.deviations.forEach((deviation) => add(deviation, areaOfSample(result, cloud)));
  map.compared.forEach((compared, face) => {
    if (compared > 0 && !cloud) add(map.deviation[face]!, compared);
    areas[STEPS]! += Math.max(0, map.asked[face]! - compared);
  });
  const edge = (step: number): number => limit * ((2 * step) / STEPS - 1);
  const steps = Array.from({ length: STEPS }, (_, i) => STEPS - 1 - i).map((step) => row(`step${step}`, diverging((2 * (step + 0.5)) / STEPS - 1),
    step === STEPS - 1 ? words.above(fine(edge(step))) : step === 0 ? words.below(fine(edge(1))) : words.between(fine(edge(step)), fine(edge(step + 1))), areas[step]!));
  return [...steps, row("unmeasured", UNMEASURED, words.unmeasured, areas[STEPS]!)];
}

const areaOfSample = ({ deviation: { statistics } }: Inspection, cloud: Cloud): number => (statistics?.area_mm2 ?? 0) / cloud.count;

/** Largest deviation that the colours of the server's report tell apart. */
function limitOf({ deviation: { statistics } }: Inspection): number {
  return Math.max(1e-3, Math.abs(statistics?.p1_mm ?? 1), Math.abs(statistics?.p99_mm ?? 1));
}

interface Face { face: number; point: Vector }

export function ScanMap({ job, result, map, kind, onKind, pin, onPin }: {
  job: InspectionJob; result: Inspection; map: FaceMap; kind: MapKind; onKind: (kind: MapKind) => void; pin: Pin | null; onPin: (pin: Pin | null) => void;
}) {
  const scene = useRef<MapScene | null>(null);
  const [stage, setStage] = useState<Stage | null>(null);
  const zoom = useSignal(0);
  const chosen = useSignal<Face | null>(null);
  const limit = limitOf(result) * 2 ** zoom.value;
  const tracer = useMemo(() => new Tracer(map.mesh.positions), [map]);
  useEffect(() => () => tracer.close(), [tracer]);
  const wantsCloud = kind === "deviation" && needsCloud(map, job);
  const { value: cloud } = useLoaded(() => (wantsCloud ? cloudOf(job.id) : Promise.resolve(null)), [job.id, wantsCloud]);
  const shown = wantsCloud ? cloud : null;
  useEffect(() => {
    scene.current = stage && new MapScene(stage, map);
    window.vantage.inspection = { scene: scene.current, map };
  }, [stage]);
  useEffect(() => scene.current?.paint(shown ? (): Rgb => UNMEASURED : painterOf(map, kind, limit)), [stage, kind, limit, shown]);
  useEffect(() => scene.current?.showCloud(shown, limit, shown ? areaOfSample(result, shown) : 1), [stage, shown, limit]);
  useEffect(() => { if (pin) chosen.value = null; }, [pin]);
  useEffect(() => scene.current?.showPin(pin?.at ?? chosen.value?.point ?? null, pin?.size ?? null), [stage, pin, chosen.value]);
  if (stage) {
    stage.onClick = (pick) => void tracer.pick(pick.origin, pick.direction, null).then((hit) => {
      onPin(null);
      chosen.value = hit && { face: hit.face, point: hit.point as Vector };
    });
  }
  const rows = useMemo(() => legendOf(map, kind, result, limit, shown), [map, kind, result, limit, shown, unit.value]);
  return (
    <View3d label={words.map} name="inspection" onStage={setStage} box={() => scene.current?.part.box ?? null}>
      <div class="overlaybar">
        <Select label={text.plan.colour} name="map" value={kind} onChange={(value) => onKind(value as MapKind)} options={Object.entries(words.maps).filter(([name]) => name !== "deviation" || hasDeviation(result))} />
        {kind === "deviation" && <Slider label={words.scale} min={-4} max={4} step={0.25} value={zoom.value} show={`± ${fine(limit)}`} onInput={(value) => { zoom.value = value; }} />}
        {chosen.value ? <FaceFigures map={map} at={chosen.value} result={result} /> : <span class="soft">{words.mapHint}</span>}
      </div>
      <Legend rows={rows} whole={result.coverage.asked_area_mm2} note={kind === "deviation" ? words.deviationNote + (shown ? "" : words.byFace) : words.facesNote} />
    </View3d>
  );
}

function FaceFigures({ map, at: { face, point }, result }: { map: FaceMap; at: Face; result: Inspection }) {
  const match = matchOf(map, face);
  const loss = match === "lost" ? result.losses.find(({ cause }) => cause === map.causes[map.cause[face]!]) : undefined;
  return (
    <div id="face" role="status" data-match={match}>
      <strong>{words.match[match]}</strong> <span class="soft">({shownPoint(point)}) {lengthUnit()}</span>
      {loss && <p>{words.losses[loss.cause] ?? loss.cause}: {loss.detail}</p>}
      {map.compared[face]! > 0 && hasDeviation(result) && <p>{words.deviation}: {fine(map.deviation[face]!)} <span class="soft">{words.uncertainty(fine(map.uncertainty[face]!))}</span></p>}
    </div>
  );
}

type Round = "measured" | "new" | "missing" | "not_asked";
const ROUND: Record<Round, Rgb> = { measured: MATCH.both!, new: MATCH.gained!, missing: LOST, not_asked: UNASKED };

/** What most of a face is after earlier rounds and the last one; what is measured once stays measured. */
function roundOf(earlier: FaceMap[], last: FaceMap | null, face: number): Round {
  const asked = earlier[0]!.asked[face]!;
  if (!(asked > 0)) return "not_asked";
  if (earlier.some(({ measured }) => measured[face]! >= asked / 2)) return "measured";
  return last && last.measured[face]! >= asked / 2 ? "new" : "missing";
}

function RoundView({ name, label, paint, map, rows, whole, onStage }: {
  name: string; label: string; paint: (face: number) => Rgb; map: FaceMap; rows: LegendRow[]; whole: number; onStage: (stage: Stage | null) => void;
}) {
  const [stage, setStage] = useState<Stage | null>(null);
  const scene = useRef<MapScene | null>(null);
  useEffect(() => {
    scene.current = stage && new MapScene(stage, map);
    scene.current?.paint(paint);
  }, [stage]);
  return (
    <View3d label={label} name={name} onStage={(made) => { setStage(made); onStage(made); }} box={() => scene.current?.part.box ?? null}>
      <Legend rows={rows} whole={whole} note={words.facesNote} />
    </View3d>
  );
}

/** The part before and after the further views of the last round; both turn together. */
export function Rounds({ maps, results }: { maps: FaceMap[]; results: Inspection[] }) {
  const stages = useRef<(Stage | null)[]>([null, null]);
  const couple = (at: number) => (stage: Stage | null): void => {
    stages.current[at] = stage;
    if (stages.current[0] && stages.current[1]) Stage.couple(stages.current[0], stages.current[1]);
  };
  const [earlier, last] = [maps.slice(0, -1), maps.at(-1)!];
  const asked = results[0]!.coverage.asked_area_mm2;
  const [before, after] = results.slice(-2).map(({ coverage }) => coverage.measured_in_all_of_asked) as [number, number];
  const row = (key: Round, share: number): LegendRow => ({ key, colour: ROUND[key], name: words.round[key]!, area: asked * share });
  const sides = [
    { name: "before", paint: (face: number) => ROUND[roundOf(earlier, null, face)], rows: [row("measured", before), row("missing", 1 - before)] },
    { name: "after", paint: (face: number) => ROUND[roundOf(earlier, last, face)], rows: [row("measured", before), row("new", after - before), row("missing", 1 - after)] },
  ];
  return (
    <div class="pair">{sides.map(({ name, paint, rows }, i) => (
      <div key={name}><h3>{words.rounds[name]}</h3>
        <RoundView name={name} label={words.rounds[name]!} map={earlier[0]!} whole={asked} paint={paint} rows={rows} onStage={couple(i)} /></div>
    ))}</div>
  );
}

// The reach of a cell, counted on demand and drawn as a dome around the plate: a patch for each direction to look from.
import { useEffect, useState } from "preact/hooks";
import { BufferGeometry, Color, DoubleSide, Float32BufferAttribute, Matrix4, Mesh, MeshBasicMaterial } from "three";
import type { CellModel } from "./cellscene";
import { ReachCounter } from "./mesh";
import { css, type Rgb } from "./palette";
import { matrixOf } from "./poses";
import { AZIMUTHS, CLEARANCE_MM, cube, direction, ELEVATIONS, type ReachMap } from "./reach";
import { length, percent } from "./settings";
import { place } from "./solids";
import type { Stage } from "./stage";
import { text } from "./text";
import { Button, guarded, Slider, Swatch } from "./widgets";

const words = text.reach;
/** Reached, something collides, out of reach. */
const COLOURS: Rgb[] = [[0, 114, 178], [230, 159, 0], [119, 121, 125]];
const NAME = "reach";

function dome(map: ReachMap, model: CellModel, edge: number): Mesh {
  const radius = edge / 2 + model.scanner.depth_mm.best;
  const [points, colours]: [number[], number[]] = [[], []];
  map.fates.forEach((fate, i) => {
    const [elevation, azimuth] = [Math.floor(i / AZIMUTHS), i % AZIMUTHS];
    const corners = [[-0.46, -0.46], [0.46, -0.46], [0.46, 0.46], [-0.46, 0.46]].map(([e, a]) =>
      direction(Math.max(0, elevation + e!), azimuth + a!).multiplyScalar(radius).toArray());
    points.push(...[0, 1, 2, 0, 2, 3].flatMap((corner) => corners[corner]!));
    const { r, g, b } = new Color(`rgb(${COLOURS[fate]!.join(",")})`);
    for (let corner = 0; corner < 6; corner += 1) colours.push(r, g, b);
  });
  const geometry = new BufferGeometry().setAttribute("position", new Float32BufferAttribute(points, 3)).setAttribute("color", new Float32BufferAttribute(colours, 3));
  const made = new Mesh(geometry, new MeshBasicMaterial({ vertexColors: true, transparent: true, opacity: 0.45, side: DoubleSide, depthWrite: false }));
  made.name = NAME;
  return place(made, matrixOf(model.cell.base_from_table).multiply(new Matrix4().makeTranslation(0, 0, edge / 2)));
}

function remove(stage: Stage): void {
  const old = stage.scene.getObjectByName(NAME);
  if (!old) return;
  (old as Mesh).geometry.dispose();
  stage.scene.remove(old);
  stage.invalidate();
}

export function ReachPanel({ stage, load }: { stage: Stage | null; load: () => Promise<CellModel> | CellModel }) {
  const [edge, setEdge] = useState(120);
  const [share, setShare] = useState<number | null>(null);
  const [map, setMap] = useState<ReachMap | null>(null);
  const [counter, setCounter] = useState<ReachCounter | null>(null);
  useEffect(() => () => counter?.close(), [counter]);
  useEffect(() => () => { if (stage) remove(stage); }, [stage]);
  const forget = (): void => {
    counter?.close();
    setCounter(null);
    setShare(null);
    setMap(null);
    if (stage) remove(stage);
  };
  const count = (): void => {
    forget();
    const made = new ReachCounter();
    setCounter(made);
    setShare(0);
    void guarded(async () => {
      const model = await load();
      const { cell, robot, table, scanner, meshes } = model;
      const half = edge / 2;
      const found = await made.count({ cell, robot, table, scanner, clearanceMm: CLEARANCE_MM, part: cube(edge), fixture: null,
        tableFromPart: { translation_mm: [-half, -half, 0], quaternion_xyzw: [0, 0, 0, 1] },
        meshes: Object.fromEntries(Object.entries(meshes).map(([id, mesh]) => [id, mesh.positions])) }, edge, setShare);
      setMap(found);
      if (stage) { stage.scene.add(dome(found, model, edge)); stage.invalidate(); }
    }).finally(() => setShare(null));
  };
  const of = (fate: number): number => map?.fates.filter((other) => other === fate).length ?? 0;
  return (
    <details class="group reach" data-directions={map?.directions} data-elevations={map?.elevations}>
      <summary>{words.title}</summary>
      <p class="soft">{words.hint(length(CLEARANCE_MM))}</p>
      <Slider label={words.edge} min={20} max={400} step={10} value={edge} show={length(edge)} onInput={(value) => { setEdge(value); forget(); }} />
      <p class="actions">
        <Button kind="primary" disabled={share !== null} onClick={count}>{words.count}</Button>
        {(map || share !== null) && <Button onClick={forget}>{words.clear}</Button>}
        {share !== null && <span role="status">{words.counting(percent(share, 0))}</span>}
      </p>
      {map && (
        <>
          <p><strong>{words.result(map.elevations, ELEVATIONS, map.directions, ELEVATIONS * AZIMUTHS)}</strong></p>
          <ul class="legend-list">{words.fates.map((name, fate) => <li key={name}><Swatch colour={css(COLOURS[fate]!)} /> {name}: {of(fate)}</li>)}</ul>
        </>
      )}
    </details>
  );
}

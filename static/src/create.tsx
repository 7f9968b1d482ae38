// A new plan: a mesh is dropped and looked at before anything is sent, its unit asked for, its size held against the scanner's
// field and the plate; then cell, parameters and placement; or all of that taken from a job and changed.
import { batch, effect, signal, type Signal } from "@preact/signals";
import { useEffect, useMemo, useRef, useState } from "preact/hooks";
import { Box3, Euler, Group, Matrix4, Vector3 } from "three";
import { ask, idempotencyKey, post, uploadMesh, type Cell, type Job, type Mesh, type Page, type Pose, type ScannerSpec, type Turntable } from "./api";
import { dropped } from "./dropped";
import { copied, JobProblem, labelsOf, withSet } from "./joblist";
import { cellName, keepJob, scannerName } from "./jobs";
import { preview, readFile, stablePoses, type Preview } from "./mesh";
import { matrixOf } from "./poses";
import type { Read } from "./readmesh";
import { apiDocument, changesOf, nested, ParamForm, toCorrect, type Api } from "./schema";
import { area, count, fileSize, hrefOf, percent, sizes, length } from "./settings";
import { lines, plateOf } from "./solids";
import { PartMesh, STANDARD_VIEWS, type Stage } from "./stage";
import { text } from "./text";
import { drawTurned } from "./thumbnail";
import { Button, goToMade, guarded, message, NumberInput, Pending, Select, Slider, useLoaded } from "./widgets";
import { View3d } from "./view3d";

const MM: Record<string, number> = { mm: 1, cm: 10, m: 1000, inch: 25.4 };
const RAD = Math.PI / 180;

interface Entry { file: File; reading: Promise<Read | null>; read: Read | null; mesh: Mesh | null; share: number; problem: string; isStarted?: boolean }
/** Turns, degrees; where the middle of the part's box comes to lie, and how far its lowest point is above the plate, mm. */
interface Placement { roll: number; pitch: number; yaw: number; x: number; y: number; z: number }
/** Tells files of one name apart. */
const idOf = ({ name, size, lastModified }: File): string => [name, size, lastModified].join();
const AS_IN_FILE: Placement = { roll: 0, pitch: 0, yaw: 0, x: 0, y: 0, z: 0 };
interface Choice { cell: string; scanner: string; partNumber: string; serial: string; labels: string; priority: number }

/** What the reader has given for a plan. */
interface Form {
  entries: Signal<Entry[]>; unit: Signal<string>; params: Signal<Record<string, unknown>>; place: Signal<Placement | null>; choice: Signal<Choice>;
  /** Uploads and starts under way, for which the unit stays as it is. */
  sending: Signal<number>;
}

const NO_NUMBERS = { partNumber: "", serial: "", labels: "", priority: 0 };
const newForm = (): Form => ({
  entries: signal([]), unit: signal(""), params: signal({}), place: signal(null), choice: signal({ cell: "", scanner: "", ...NO_NUMBERS }), sending: signal(0),
});

/** The form of a new plan, which is there again when the reader comes back to it; one that is based on a job begins from that. */
const draft = newForm();

/** Clears a form whose jobs were started; the hardware is that of the next one too. */
const clear = ({ entries, unit, params, place, choice }: Form): void => batch(() => {
  entries.value = entries.peek().filter((entry) => !entry.isStarted);
  // What was added meanwhile is the next plan.
  if (!entries.value.length) [unit.value, params.value, place.value, choice.value] = ["", {}, null, { ...choice.peek(), ...NO_NUMBERS }];
});

/** Asks the reader before the page is left with a form that is filled. */
const warn = (event: BeforeUnloadEvent): void => event.preventDefault();
effect(() => {
  const { partNumber, serial, labels, priority } = draft.choice.value;
  const isFilled = draft.entries.value.length > 0 || Object.keys(draft.params.value).length > 0 || Boolean(partNumber || serial || labels || priority);
  (isFilled ? addEventListener : removeEventListener)("beforeunload", warn);
});

/** What a form said as it was sent. */
type Given = [params: Record<string, unknown>, place: Placement | null, choice: Choice];

/** The hardware beside which sizes are shown, and the lengths, mm, that the server wants the longest edge of a part to have. */
interface Bounds { field: [number, number, number] | null; plate: Turntable | null; edge: [min: number, max: number] | null }
const UNKNOWN: Bounds = { field: null, plate: null, edge: null };

async function boundsOf({ cell: name, scanner: alone }: Choice): Promise<Bounds> {
  const isAlone = name === "none";
  const [{ part_edge_mm: edge }, cell] = await Promise.all([
    // Of no parameters at all, the answer would be that they are no document.
    post<{ part_edge_mm: Bounds["edge"] }>("/check", { document: { part: {} }, cell: name, ...(isAlone && { scanner: alone }) }),
    isAlone ? { scanner: alone, turntable: null } : ask<Cell>(`/cells/${encodeURIComponent(name)}`),
  ]);
  const [scanner, plate] = await Promise.all([
    typeof cell.scanner === "string" ? ask<ScannerSpec>(`/scanners/${encodeURIComponent(cell.scanner)}`) : cell.scanner,
    typeof cell.turntable === "string" ? ask<Turntable>(`/turntables/${encodeURIComponent(cell.turntable)}`) : cell.turntable,
  ]);
  return { field: scanner.practical_volume_mm, plate, edge };
}

function verdictOf(size: number[], { edge }: Bounds): { fits: boolean; words: string } {
  // Not known yet, or not to be read.
  if (!edge) return { fits: true, words: text.none };
  const longest = Math.max(...size);
  if (longest < edge[0]) return { fits: false, words: text.create.tiny };
  return longest > edge[1] ? { fits: false, words: text.create.fitsNot } : { fits: true, words: text.create.fits };
}

const sizeIn = ({ min, max }: Read, unit: string): number[] => max.map((value, i) => (value - min[i]!) * MM[unit]!);

/** Size of one of several files, and whether it fits. */
function Fit({ read, unit, bounds }: { read: Read; unit: string; bounds: Bounds }) {
  const size = sizeIn(read, unit);
  const { fits, words } = verdictOf(size, bounds);
  return <span class={fits ? "soft" : "bad"}> · {sizes(size)}, {words}</span>;
}

function UnitTable({ read, bounds, unit, isFixed, onUnit }: { read: Read; bounds: Bounds; unit: string; isFixed: boolean; onUnit: (unit: string) => void }) {
  return (
    <table class="units">
      <caption>{text.create.unitTable}</caption>
      <tbody>
        {Object.keys(MM).map((name) => {
          const size = sizeIn(read, name);
          const { fits, words } = verdictOf(size, bounds);
          return (
            <tr key={name} class={name === unit ? "chosen" : ""}>
              <th scope="row"><button type="button" class="link" disabled={isFixed} onClick={() => onUnit(name)}>{name}</button></th>
              <td class="number">{sizes(size)}</td><td class={fits ? "good" : "bad"}>{words}</td>
            </tr>
          );
        })}
        {bounds.field && <tr class="soft"><th scope="row">{text.create.field}</th><td class="number">{sizes(bounds.field)}</td><td /></tr>}
        {bounds.plate && <tr class="soft"><th scope="row">{text.create.plate}</th><td class="number">⌀ {length(bounds.plate.plate_diameter_mm)}</td><td /></tr>}
      </tbody>
    </table>
  );
}

export function Health({ mesh }: { mesh: Mesh }) {
  const { health } = mesh;
  const row = (name: string, value: string) => <tr><th scope="row">{name}</th><td class="number">{value}</td></tr>;
  const words = text.create;
  return (
    <div class="health">
      <h2>{words.health}</h2>
      <table><tbody>
        {row(words.part, sizes(health.bbox_mm.max.map((max, i) => max - health.bbox_mm.min[i]!)))}
        {row(words.triangles, count(health.triangles))}{row(words.bodies, String(health.bodies))}
        {row(words.surface, area(health.area_mm2))}{row(words.closed, health.watertight ? words.yes : words.no)}
      </tbody></table>
      {health.warnings.length === 0 && <p class="good">{words.healthy}</p>}
      {health.warnings.map((note) => <p key={note.code} class="warning">{note.detail}<br />→ {note.remedy}</p>)}
    </div>
  );
}

const turnOf = (place: Placement): Matrix4 =>
  new Matrix4().makeRotationFromEuler(new Euler(place.roll * RAD, place.pitch * RAD, place.yaw * RAD, "ZYX"));

/** The part as it lies, and its box. */
function lying(positions: Float32Array, scale: number, place: Placement): { matrix: Matrix4; box: Box3 } {
  const turn = turnOf(place).multiply(new Matrix4().makeScale(scale, scale, scale));
  const box = new Box3();
  const point = new Vector3();
  for (let i = 0; i < positions.length; i += 3) box.expandByPoint(point.fromArray(positions, i).applyMatrix4(turn));
  const middle = box.getCenter(new Vector3());
  const shift = new Vector3(place.x - middle.x, place.y - middle.y, place.z - box.min.z);
  box.translate(shift);
  return { matrix: new Matrix4().makeTranslation(shift.x, shift.y, shift.z).multiply(turn), box };
}

/** Placement that a pose of the parameters says; null for what is no whole pose. */
function placementOf(positions: Float32Array, scale: number, given: unknown): Placement | null {
  const { translation_mm: at, quaternion_xyzw: quaternion, rpy_deg: angles } = (given ?? {}) as Record<string, unknown>;
  const hasNumbers = (list: unknown, count: number): boolean => Array.isArray(list) && list.length === count && list.every(Number.isFinite);
  if (!hasNumbers(at, 3) || !(hasNumbers(quaternion, 4) || hasNumbers(angles, 3))) return null;
  const { x, y, z } = new Euler().setFromRotationMatrix(matrixOf(given as Pose), "ZYX");
  const turn = { ...AS_IN_FILE, roll: x / RAD, pitch: y / RAD, yaw: z / RAD };
  // Where the middle and the lowest point would be is how far they are from where the pose has them.
  const shift = new Vector3().setFromMatrixPosition(lying(positions, scale, turn).matrix).negate().add(new Vector3().fromArray(at as number[]));
  return { ...turn, x: shift.x, y: shift.y, z: shift.z };
}

/** Pose of a part that is placed, for the parameters. */
function poseOfPlaced(positions: Float32Array, scale: number, place: Placement): Record<string, number[]> {
  // The pose is one of the part in millimetres, whatever the scale of what is drawn.
  const at = new Vector3().setFromMatrixPosition(lying(positions, scale, place).matrix).toArray();
  return { translation_mm: at, rpy_deg: [place.roll, place.pitch, place.yaw] };
}

function asPreview(read: Read): Preview {
  const faces = read.positions.length / 9;
  return { positions: read.positions, areas: new Float64Array(faces), faces, min: read.min as Preview["min"], max: read.max as Preview["max"],
    sourceFaces: (face) => [face], faceOf: (face) => face };
}

function fieldLines(field: number[]): number[] {
  const [x, y, z] = field.map((value) => value / 2) as [number, number, number];
  const c = [[-x, -y], [x, -y], [x, y], [-x, y]] as const;
  return c.flatMap(([a, b], i) => {
    const [d, e] = c[(i + 1) % 4]!;
    return [a, b, 0, d, e, 0, a, b, 2 * z, d, e, 2 * z, a, b, 0, a, b, 2 * z];
  });
}

/** Part, plate and field to scale. */
function Look({ shape, scale, bounds, place }: { shape: Preview; scale: number; bounds: Bounds; place: Placement }) {
  const stage = useRef<Stage | null>(null);
  const box = useRef<Box3 | null>(null);
  const isFirst = useRef(true);
  const [, ready] = useState(0);
  useEffect(() => {
    const at = stage.current;
    if (!at) return;
    const old = at.scene.getObjectByName("look");
    if (old) { at.clear(old); at.scene.remove(old); }
    const group = new Group();
    group.name = "look";
    const part = new PartMesh(shape);
    part.paint(() => [176, 186, 198]);
    const { matrix, box: lain } = lying(shape.positions, scale, place);
    part.mesh.matrixAutoUpdate = false;
    part.mesh.matrix.copy(matrix);
    group.add(part.mesh);
    if (bounds.plate) group.add(plateOf(bounds.plate));
    if (bounds.field) group.add(lines(fieldLines(bounds.field), 0xe69f00));
    at.scene.add(group);
    box.current = lain.clone();
    if (bounds.plate) box.current.expandByPoint(new Vector3(-bounds.plate.plate_diameter_mm / 2, -bounds.plate.plate_diameter_mm / 2, 0))
      .expandByPoint(new Vector3(bounds.plate.plate_diameter_mm / 2, bounds.plate.plate_diameter_mm / 2, 0));
    const labels = [{ at: new Vector3(lain.max.x, lain.max.y, lain.max.z), text: sizes(lain.getSize(new Vector3()).toArray()) }];
    at.setLabels(labels);
    if (isFirst.current) at.look(box.current, STANDARD_VIEWS.iso!);
    else at.fit(box.current);
    isFirst.current = false;
  });
  return <View3d label={text.create.look} name="look" box={() => box.current} onStage={(made) => { stage.current = made; if (made) ready((n) => n + 1); }} />;
}

/** Turns about X and Y, degrees, that bring a direction of the part to point down. */
function turned([x, y, z]: [number, number, number]): { roll: number; pitch: number } {
  const upright = Math.hypot(y, z) > 1e-9;
  return { roll: upright ? Math.atan2(-y, -z) / RAD : 0, pitch: Math.asin(Math.max(-1, Math.min(1, x))) / RAD };
}

const SIDES: [number, number, number][] = [[0, 0, -1], [0, 0, 1], [-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0]];

/** Picture of the part as it would lie. */
function Lying({ shape, down }: { shape: Preview; down: [number, number, number] }) {
  const canvas = useRef<HTMLCanvasElement>(null);
  useEffect(() => { void drawTurned(canvas.current!, shape, turnOf({ ...AS_IN_FILE, ...turned(down) })); }, [shape]);
  return <canvas ref={canvas} class="thumb" width={144} height={108} aria-hidden="true" />;
}

/** The ways in which the part can stand, a picture each. */
function StableList({ shape, at, onPlace }: { shape: Preview; at: Placement | null; onPlace: (place: Placement) => void }) {
  const { value, error } = useLoaded(() => stablePoses(shape.positions), [shape]);
  const words = text.create;
  const isChosen = (down: [number, number, number]): boolean => {
    const { roll, pitch } = turned(down);
    return at !== null && Math.abs(at.roll - roll) < 0.01 && Math.abs(at.pitch - pitch) < 0.01;
  };
  if (error) return <p class="problem" role="alert">{error}</p>;
  if (!value) return <Pending />;
  if (value.length === 0) return <p class="soft">{words.noStable}</p>;
  return (
    <ul class="poses scroll" aria-label={words.stable}>
      {value.map(({ down, share }, i) => (
        <li key={down.join()}><button type="button" aria-pressed={isChosen(down)} onClick={() => onPlace({ ...AS_IN_FILE, ...turned(down) })}>
          <Lying shape={shape} down={down} /><span>{words.pose(i + 1, percent(share, 0))}</span></button></li>
      ))}
    </ul>
  );
}

function PlacementForm({ at, isStated, onPlace, shape, note }: {
  at: Placement | null; isStated: boolean; onPlace: (place: Placement | null) => void; shape: Preview; note: string;
}) {
  const [isOpen, setOpen] = useState(false);
  const set = (change: Partial<Placement>): void => onPlace({ ...at!, ...change });
  const words = text.create;
  const turn = (name: string, key: "roll" | "pitch" | "yaw") => (
    <Slider label={name} min={-180} max={180} step={1} value={at![key]} show={`${Math.round(10 * at![key]) / 10}°`} onInput={(value) => set({ [key]: value })} />
  );
  const move = (name: string, key: "x" | "y" | "z") => (
    <Slider label={name} min={-250} max={250} value={at![key]} show={length(at![key])} onInput={(value) => set({ [key]: value })} />
  );
  return (
    <details class="group placing" onToggle={(event) => setOpen(event.currentTarget.open)}>
      <summary>{words.placing} <span class="soft">{isStated ? words.placeStated : at ? words.placeHand : words.placeAuto}</span></summary>
      {note && <p class="warning">{note}</p>}
      <label class="check"><input type="checkbox" checked={at === null} onChange={(event) => onPlace(event.currentTarget.checked ? null : AS_IN_FILE)} />{words.placeAuto}</label>
      <h2>{words.stable}</h2>
      {/* The poses come late: their room is there before them, so that nothing below moves under the pointer. */}
      <div class="stable">{isOpen && <StableList shape={shape} at={at} onPlace={onPlace} />}</div>
      <h2>{words.placeHand}</h2>
      <p class="soft">{words.placingHint}</p>
      <p class="actions" role="group" aria-label={words.sides}>
        {SIDES.map((down, i) => <Button key={i} onClick={() => onPlace({ ...AS_IN_FILE, ...turned(down) })}>{words.faces[i]}</Button>)}
      </p>
      {at && (
        <>
          {turn(words.turnX, "roll")}{turn(words.turnY, "pitch")}{turn(words.turnZ, "yaw")}
          {move(words.moveX, "x")}{move(words.moveY, "y")}
          {Math.abs(at.z) > 0.01 && move(words.moveZ, "z")}
        </>
      )}
    </details>
  );
}

/** Names with that of a cell or scanner of the job's own, which the server has under no name. */
const withOwn = (names: string[], name: string): string[] => (names.includes(name) || name === "none" ? names : [name, ...names]);

function HardwareForm({ choice, names }: { choice: Signal<Choice>; names: { cells: string[]; scanners: string[] } }) {
  const set = (change: Partial<Choice>): void => { choice.value = { ...choice.value, ...change }; };
  const field = (label: string, key: "partNumber" | "serial" | "labels", hint: string) => (
    <label><span>{label}</span><input type="text" maxLength={128} autocomplete="off" placeholder={hint} value={choice.value[key]}
      onInput={(event) => set({ [key]: event.currentTarget.value })} /></label>
  );
  return (
    <div class="grid">
      <div data-field="cell"><Select label={text.create.cell} name="cell" value={choice.value.cell} onChange={(cell) => set({ cell })}
        options={[...withOwn(names.cells, choice.value.cell).map((name): [string, string] => [name, name]), ["none", text.create.cellNone]]} /></div>
      {choice.value.cell === "none" && (
        <div data-field="scanner"><Select label={text.create.scanner} name="scanner" value={choice.value.scanner} onChange={(scanner) => set({ scanner })}
          options={withOwn(names.scanners, choice.value.scanner).map((name) => [name, name])} /></div>
      )}
      {field(text.create.partNumber, "partNumber", text.create.optional)}{field(text.create.serial, "serial", text.create.optional)}
      {field(text.create.labels, "labels", "key=value, key=value")}
      <label><span>{text.create.priority}</span><NumberInput step={1} min={-100} max={100} value={choice.value.priority} onNumber={(priority) => set({ priority: priority ?? 0 })} /></label>
    </div>
  );
}

/** Labels of a job in one line. */
const written = ({ labels }: Job): string => Object.entries(copied(labels)).map(([name, value]) => `${name}=${value}`).join(", ");

/** Fault of labels in one line; empty where they are pairs. */
function labelFault(labels: string): string {
  try {
    labelsOf(labels.split(","));
    return "";
  } catch (error) {
    return (error as Error).message;
  }
}

/** Request for a plan; cell and scanner are those of the job that it is based on, as long as no others are chosen. */
function requestOf(mesh: Mesh, choice: Choice, params: Record<string, unknown>, from: Job | undefined): Record<string, unknown> {
  const request: Record<string, unknown> = { mesh_id: mesh.id, cell: from && cellName(from) === choice.cell ? from.cell : choice.cell, params };
  if (choice.cell === "none") request.scanner = from && scannerName(from) === choice.scanner ? from.scanner : choice.scanner;
  if (choice.partNumber) request.part_number = choice.partNumber;
  if (choice.serial) request.serial = choice.serial;
  if (choice.priority) request.priority = choice.priority;
  // The value of a label that is taken over may have a comma.
  request.labels = from && choice.labels === written(from) ? copied(from.labels) : labelsOf(choice.labels.split(","));
  return request;
}

function Files({ entries, unit, bounds, onFiles, onUpload, onDrop }: {
  entries: Signal<Entry[]>; unit: string; bounds: Bounds; onFiles: (files: File[]) => void; onUpload: (entry: Entry) => Promise<unknown>; onDrop: (entry: Entry) => void;
}) {
  const [isOver, setOver] = useState(false);
  return (
    <div class={`drop ${isOver ? "over" : ""}`} onDragOver={(event) => { event.preventDefault(); setOver(true); }} onDragLeave={() => setOver(false)}
      onDrop={(event) => { event.preventDefault(); event.stopPropagation(); setOver(false); onFiles([...(event.dataTransfer?.files ?? [])]); }}>
      <label class="file"><span>{text.create.drop}</span>
        <input type="file" name="file" multiple accept=".stl,.obj,.ply" onChange={(event) => {
          onFiles([...(event.currentTarget.files ?? [])]);
          // A file that is removed can be chosen again.
          event.currentTarget.value = "";
        }} />
      </label>
      <p class="soft">{text.create.dropHint}</p>
      <ul>
        {entries.value.map((entry) => (
          <li key={idOf(entry.file)}>
            <strong>{entry.file.name}</strong> <span class="soft">{fileSize(entry.file.size)}{entry.read && ` · ${count(entry.read.faces)} ${text.create.triangles.toLowerCase()}`}</span>
            {entries.value.length > 1 && entry.read && unit && <Fit read={entry.read} unit={unit} bounds={bounds} />}
            {entry.share > 0 && !entry.mesh && <progress max={1} value={entry.share} aria-label={text.create.uploading(entry.file.name)} />}
            {entry.mesh && <span class="good"> ✓ {percent(1, 0)}</span>}
            {!entry.mesh && unit && entry.share === 0 && <Button onClick={() => onUpload(entry)}>{text.create.upload}</Button>}
            {" "}<Button onClick={() => onDrop(entry)} aria-label={text.create.drop1(entry.file.name)}>×</Button>
            {entry.problem && <p class="problem" role="alert">{entry.problem}</p>}
          </li>
        ))}
      </ul>
    </div>
  );
}

interface Base { job: Job; mesh: Mesh; shape: Preview; changes: Record<string, unknown> }

async function baseOf(id: string, api: Api): Promise<Base> {
  const job = await ask<Job>(`/jobs/${id}`);
  const mesh = await ask<Mesh>(`/meshes/${job.mesh_id}`);
  return { job, mesh, shape: await preview(mesh.id), changes: nested(changesOf(api, job.params ?? {})) };
}

async function namesOf(): Promise<{ cells: string[]; scanners: string[] }> {
  const [cells, scanners] = await Promise.all([ask<Page<{ name: string }>>("/cells"), ask<Page<{ name: string }>>("/scanners")]);
  return { cells: cells.items.map((item) => item.name), scanners: scanners.items.map((item) => item.name) };
}

const prefer = (names: string[], wanted: string): string => (names.includes(wanted) ? wanted : names[0] ?? "none");

/** Parameters that a link offers, by path; nothing where the link has none that can be read. */
function offeredBy(set: string | null): [string, unknown][] {
  try {
    return Object.entries(JSON.parse(set ?? "{}") as Record<string, unknown>);
  } catch {
    return [];
  }
}

/** Moves the reader to a field of the form. */
function showField(name: string): void {
  const field = document.querySelector<HTMLElement>(`[data-field="${CSS.escape(name)}"]`);
  field?.scrollIntoView({ block: "center" });
  field?.querySelector<HTMLElement>("input, select, textarea, button")?.focus({ preventScroll: true });
}

export function Create({ from, set, at: field }: { from: string | null; set: string | null; at: string | null }) {
  const form = useMemo(() => (from ? newForm() : draft), [from]);
  const { entries, unit, params, place, choice, sending } = form;
  const [base, setBase] = useState<Base | null>(null);
  const offered = offeredBy(set);
  const [bounds, setBounds] = useState(UNKNOWN);
  const { value: api, error: noApi } = useLoaded(apiDocument, []);
  const { value: names, error: noNames } = useLoaded(namesOf, []);

  const replace = (entry: Entry, change: Partial<Entry>): void => {
    entries.value = entries.value.map((other) => (other.file === entry.file ? { ...other, ...change } : other));
  };
  const take = (files: File[]): void => {
    setBase(null);
    const [known, fresh] = [true, false].map((isKnown) => files.filter((file) => entries.value.some((entry) => idOf(entry.file) === idOf(file)) === isKnown)) as [File[], File[]];
    message.value = known.map(({ name }) => text.create.inList(name)).join("\n");
    for (const file of fresh) {
      const reading = readFile(file);
      const entry: Entry = { file, reading: reading.catch(() => null), read: null, mesh: null, share: 0, problem: "" };
      entries.value = [...entries.value, entry];
      reading.then((read) => replace(entry, { read }), (error: Error) => replace(entry, { problem: error.message === text.viewGone ? text.create.notRead : text.create.notDrawn }));
    }
  };
  const whileSending = async <T,>(work: () => Promise<T>): Promise<T> => {
    sending.value += 1;
    return work().finally(() => { sending.value -= 1; });
  };
  const upload = async (entry: Entry): Promise<Mesh> => {
    const known = entries.value.find((other) => other.file === entry.file)?.mesh;
    if (known) return known;
    const asked = unit.value;
    replace(entry, { share: 0.001, problem: "" });
    try {
      const mesh = await uploadMesh(entry.file, asked, (share) => replace(entry, { share: Math.max(0.001, share) }));
      replace(entry, unit.value === asked ? { mesh } : { share: 0 });
      return mesh;
    } catch (error) {
      replace(entry, { share: 0, problem: (error as Error).message });
      throw error;
    }
  };
  // A mesh that was read in another unit is another mesh.
  const chooseUnit = (chosen: string): void => {
    unit.value = chosen;
    entries.value = entries.value.map((entry) => ({ ...entry, mesh: null, share: 0 }));
  };

  useEffect(() => { if (dropped.value.length) { take(dropped.value); dropped.value = []; } }, [dropped.value]);
  useEffect(() => {
    if (names && !choice.value.cell) {
      choice.value = { ...choice.value, cell: prefer(names.cells, "e05-transcan"), scanner: prefer(names.scanners, "transcan-c") };
    }
  }, [names]);
  useEffect(() => {
    if (!from || !api) return;
    void guarded(async () => {
      const made = await baseOf(from, api);
      setBase(made);
      params.value = withSet(made.changes, Object.fromEntries(offered));
      const { job } = made;
      choice.value = { cell: cellName(job), scanner: scannerName(job), partNumber: job.part_number ?? "", serial: job.serial ?? "",
        labels: written(job), priority: job.priority };
    });
  }, [from, api]);
  useEffect(() => {
    if (!choice.value.cell) return;
    // Limits of the hardware that was chosen before are not those of this one, however late they come.
    let isCurrent = true;
    const show = (of: Bounds): void => { if (isCurrent) setBounds(of); };
    show(UNKNOWN);
    boundsOf(choice.value).then(show, () => {});
    return () => { isCurrent = false; };
  }, [choice.value.cell, choice.value.scanner]);

  const isOpened = base !== null && api !== null && names !== null;
  useEffect(() => { if (isOpened && field) requestAnimationFrame(() => showField(field)); }, [isOpened, field]);

  const first = entries.value.find((entry) => entry.read) ?? entries.value[0];
  const shape = base?.shape ?? (first?.read ? cachedPreview(first.read) : null);
  const scale = base ? 1 : MM[unit.value] ?? 1;
  const part = (params.value.part ?? {}) as { table_from_part?: unknown };
  const stated = useMemo(() => shape && placementOf(shape.positions, scale, part.table_from_part), [shape, scale, part.table_from_part]);
  const at = place.value ?? stated;
  const setPlace = (chosen: Placement | null): void => {
    place.value = chosen;
    const { table_from_part: _, ...rest } = part;
    params.value = { ...params.value, part: rest };
  };
  /** Starts the plan of one mesh; a placement by hand is that of its own box. */
  const startOne = async ([params, place, choice]: Given, positions: Float32Array | undefined, send: () => Promise<Mesh>): Promise<Job> => {
    let all = params;
    if (place) {
      if (!positions) throw new Error(text.create.notPlaced);
      all = { ...all, part: { ...part, table_from_part: poseOfPlaced(positions, scale, place) } };
    }
    const job = await post<Job>("/jobs", requestOf(await send(), choice, all, base?.job), idempotencyKey());
    keepJob(job);
    return job;
  };
  const start = async (): Promise<string> => {
    // What the form says while the meshes are sent is for the next plan.
    const given: Given = [params.value, place.value, choice.value];
    const jobs: Job[] = base ? [await startOne(given, base.shape.positions, async () => base.mesh)] : [];
    const problems: string[] = [];
    for (const entry of entries.value) {
      // Removed while those before it were sent.
      if (!entries.value.some((other) => other.file === entry.file)) continue;
      try {
        jobs.push(await startOne(given, (await entry.reading)?.positions, () => upload(entry)));
        replace(entry, { isStarted: true });
      } catch (error) {
        const problem = (error as Error).message;
        replace(entry, { problem });
        problems.push(`${entry.file.name}: ${problem}`);
      }
    }
    if (problems.length > 0) {
      entries.value = entries.value.filter((entry) => !entry.isStarted);
      throw new Error([...problems, ...(jobs.length > 0 ? [text.create.othersStarted(jobs.length)] : [])].join("\n"));
    }
    if (form === draft) clear(draft);
    return hrefOf(jobs.length === 1 ? ["jobs", jobs[0]!.id] : ["jobs"]);
  };
  const { cell, labels } = choice.value;
  const fault = toCorrect() || (base && labels === written(base.job) ? "" : labelFault(labels)) || (first && !unit.value ? text.create.readFirst : "");
  const canStart = Boolean(base ?? first) && Boolean(cell) && !fault && sending.value === 0;
  const meshShown = base?.mesh ?? first?.mesh;
  // What is filled in before would be overwritten.
  const isRead = base || !from;

  return (
    <section class="create" aria-labelledby="create-title">
      <div class="form">
        <h1 id="create-title">{base ? text.create.cloneTitle : text.create.title}</h1>
        {base && offered.length > 0 && <p class="warning" role="status">{text.create.offered} {offered.map(([name, value]) => <code key={name}>{name} = {JSON.stringify(value)} </code>)}</p>}
        {base && <JobProblem job={base.job} />}
        {base && <p>{text.create.from} <a href={hrefOf(["jobs", base.job.id])}>{base.mesh.name ?? base.job.id}</a></p>}
        {!base && !from && (
          <>
            <Files entries={entries} unit={unit.value} bounds={bounds} onFiles={take} onUpload={(entry) => whileSending(() => upload(entry))}
              onDrop={(entry) => { entries.value = entries.value.filter((other) => other.file !== entry.file); }} />
            {entries.value.length > 0 && (
              <>
                <Select label={text.create.unit} name="unit" required disabled={sending.value > 0} value={unit.value} onChange={chooseUnit}
                  options={[["", text.create.unitChoose], ...Object.keys(MM).map((name): [string, string] => [name, name])]} />
                {first?.read && <p class="soft">{text.create.unitWhy}</p>}
              </>
            )}
            {first?.read && <UnitTable read={first.read} bounds={bounds} unit={unit.value} isFixed={sending.value > 0} onUnit={chooseUnit} />}
          </>
        )}
        {meshShown && <Health mesh={meshShown} />}
        {(noApi || noNames) && <p class="problem" role="alert">{noApi || noNames}</p>}
        {isRead && names && choice.value.cell && <HardwareForm choice={choice} names={names} />}
        {shape && (base || unit.value) && <PlacementForm at={at} isStated={place.value === null && at !== null} onPlace={setPlace} shape={shape}
          note={entries.value.length > 1 ? text.create.placeMany(first!.file.name) : ""} />}
        {isRead && api && (
          <details class="group" open={base !== null && field !== null && field !== "cell" && field !== "scanner"}>
            <summary>{text.create.parameters} <span class="soft">{text.create.changed(Object.values(params.value).reduce<number>((sum, group) =>
              sum + (group && typeof group === "object" && !Array.isArray(group) ? Object.keys(group).length : 1), 0))}</span></summary>
            <p class="soft">{text.create.parametersHint}</p>
            <ParamForm key={base?.job.id ?? "new"} api={api} at={base && field} value={params.value} onChange={(value) => { params.value = value; }} />
          </details>
        )}
        <p class="actions sticky">
          <Button kind="primary" disabled={!canStart} onClick={() => whileSending(() => goToMade(start))}>{entries.value.length > 1 ? text.create.startAll(entries.value.length) : text.create.start}</Button>
          {fault && <span class="soft" role="status">{fault}</span>}
        </p>
      </div>
      {shape && <div class="look"><Look shape={shape} scale={scale} bounds={bounds} place={at ?? AS_IN_FILE} /></div>}
    </section>
  );
}

const previews = new WeakMap<Read, Preview>();
function cachedPreview(read: Read): Preview {
  const known = previews.get(read) ?? asPreview(read);
  previews.set(read, known);
  return known;
}

// Hardware: scanners, robots, turntables and cells, read and edited with the server's own check while one types, and drawn.
import { useSignal } from "@preact/signals";
import { useEffect, useRef, useState } from "preact/hooks";
import { Box3, BoxGeometry, EdgesGeometry, Group, LineBasicMaterial, LineSegments, Matrix4 } from "three";
import { ask, askVersion, post, putVersion, Refused, remove, type Body, type Cell, type Device, type Note, type Page, type ProblemField, type Robot, type Scanner, type ScannerSpec, type Turntable } from "./api";
import { CellScene, cellModelOf } from "./cellscene";
import { commonField, opticsOf } from "./optics";
import { matrixOf, poseOf, rigOf, type BoardPose } from "./poses";
import { ReachPanel } from "./reachpanel";
import { apiDocument, ObjectField, toCorrect, useUnread } from "./schema";
import { goTo, hrefOf, length, lengthIn, lengthUnit, sizes, unit, visits } from "./settings";
import { Arm, bodyMesh, bodyMeshes, frustums, lines, place, plateOf, type BodyMeshes } from "./solids";
import { STANDARD_VIEWS, type Stage } from "./stage";
import { text } from "./text";
import { Button, ConfirmButton, known, Pending, Tabs, useLoaded } from "./widgets";
import { View3d } from "./view3d";

const words = text.specs;
const KINDS = ["scanners", "robots", "turntables", "cells"] as const;
const SCHEMAS: Record<string, string> = { scanners: "ScannerSpec", robots: "RobotSpec", turntables: "TurntableSpec", cells: "CellSpec" };

interface Item { name: string; preset: boolean }
interface Report { sound: boolean; findings: ProblemField[]; warnings?: Note[]; description?: string | null }

const listAll = async (): Promise<Record<string, Item[]>> => Object.fromEntries(await Promise.all(
  KINDS.map(async (kind) => [kind, (await ask<Page<Item>>(`/${kind}`)).items] as const)));

export function Specs({ kind: named, name }: { kind: string; name: string }) {
  const kind = known(words.kinds, named);
  const { value, error, reload } = useLoaded(listAll, []);
  if (error || !value) return <Pending error={error} />;
  const item = value[kind]?.find((item) => item.name === name);
  return (
    <div class="specs">
      <nav aria-label={words.title}>
        <h1>{words.title}</h1>
        {KINDS.map((room) => (
          <section key={room} aria-label={words.kinds[room]}>
            <h2>{words.kinds[room]}</h2>
            <ul>{value[room]!.map((entry) => (
              <li key={entry.name}><a href={hrefOf(["specs", room, entry.name])} aria-current={room === kind && entry.name === name ? "page" : undefined}>
                {entry.name} {!entry.preset && <span class="soft">({words.own})</span>}</a></li>
            ))}</ul>
          </section>
        ))}
      </nav>
      {item ? <Editor key={`${kind}/${name}`} kind={kind} item={item} onChanged={reload} /> : <p class="empty">{words.choose}</p>}
    </div>
  );
}

/** What a refusal for another version means to the reader. */
function inWords(refused: unknown): never {
  const reason = refused instanceof Refused && words.refused[refused.code];
  throw reason ? new Error(reason) : refused;
}

function Editor({ kind, item, onChanged }: { kind: string; item: Item; onChanged: () => void }) {
  const path = `/${kind}/${encodeURIComponent(item.name)}`;
  const { value: loaded, error } = useLoaded(() => askVersion<Record<string, unknown>>(path), [path]);
  /** Tag of the version that this page stored last. */
  const [stored, setStored] = useState("");
  const { value: api, error: noApi } = useLoaded(apiDocument, []);
  const draft = useSignal<Record<string, unknown> | null>(null);
  const [tab, setTab] = useState("form");
  const [saveAs, setSaveAs] = useState(item.name);
  const [said, setSaid] = useState("");
  useEffect(() => setSaid(""), [draft.value, saveAs]);
  const spec = draft.value ?? loaded?.value ?? null;
  const report = useCheck(spec);
  if (error || !spec || !api) return <Pending error={error || noApi} />;
  const etag = stored || loaded!.etag;
  /** Goes on to another document unless the reader has gone elsewhere meanwhile. */
  const goOn = (from: number, ...path: string[]): void => { if (visits.peek() === from) goTo(hrefOf(["specs", kind, ...path])); };
  const save = async (): Promise<void> => {
    const [isSame, from] = [saveAs === item.name, visits.peek()];
    setSaid("");
    const tag = await putVersion(`/${kind}/${encodeURIComponent(saveAs)}`, { ...spec, name: saveAs }, isSame ? etag : "").catch(inWords);
    if (isSame) setStored(tag);
    setSaid(words.saved);
    onChanged();
    if (!isSame) goOn(from, saveAs);
  };
  return (
    <>
      <div class="editor">
        <h2>{item.name} <span class="soft">{item.preset ? words.preset : words.own}</span></h2>
        {item.preset && <p class="soft">{words.presetNote}</p>}
        <CheckResult report={report} />
        <Tabs label={item.name} names={{ form: words.form, source: words.source }} chosen={tab} onChoose={setTab} />
        {tab === "form" ? <ObjectField api={api} schema={{ $ref: SCHEMAS[kind]! }} name={kind.slice(0, -1)} value={spec} onChange={(value) => { draft.value = value as Record<string, unknown>; }} />
          : <Source value={spec} onChange={(value) => { draft.value = value; }} />}
        <p class="actions sticky">
          <label><span>{words.saveAs}</span><input type="text" maxLength={128} value={saveAs} onInput={(event) => setSaveAs(event.currentTarget.value)} /></label>
          <Button kind="primary" disabled={report?.sound === false || toCorrect() !== "" || !saveAs || (item.preset && saveAs === item.name)} onClick={save}>{words.save}</Button>
          {!item.preset && <ConfirmButton label={words.remove} sure={text.sure(item.name)} onConfirm={(from = visits.peek()) => remove(path, undefined, { "If-Match": etag }).catch(inWords).then(() => { onChanged(); goOn(from); })} />}
          <span class={toCorrect() ? "problem" : "good"} role="status">{toCorrect() || said}</span>
        </p>
      </div>
      <div class="drawn"><Drawing key={kind} kind={kind} spec={spec} /></div>
    </>
  );
}

/** What the server says of a document, a moment after it was last changed. */
function useCheck(document: Record<string, unknown> | null): Report | null {
  const [report, setReport] = useState<Report | null>(null);
  useEffect(() => {
    if (!document) return undefined;
    let isCurrent = true;
    setReport(null);
    const timer = setTimeout(() => {
      post<Report>("/check", { document }).then((made) => isCurrent && setReport(made),
        (error) => isCurrent && setReport({ sound: false, findings: error.fields?.length ? error.fields : [{ pointer: "", detail: error.message }] }));
    }, 250);
    return () => { isCurrent = false; clearTimeout(timer); };
  }, [document]);
  return report;
}

function CheckResult({ report }: { report: Report | null }) {
  return (
    <div role="status" id="check" data-sound={report ? String(report.sound) : "checking"}>
      {!report && <p class="soft">{words.checking}</p>}
      {report?.sound && <p class="good">{words.sound} <span class="soft">{report.description}</span></p>}
      {report?.findings.map((finding) => <p key={finding.pointer + finding.detail} class="problem"><code>{finding.pointer}</code> {finding.detail}</p>)}
      {report?.warnings?.map((warning) => <p key={`${warning.pointer}${warning.code}`} class="warning"><code>{warning.pointer}</code> {warning.detail}<br />→ {warning.remedy}</p>)}
    </div>
  );
}

function Source({ value, onChange }: { value: Record<string, unknown>; onChange: (value: Record<string, unknown>) => void }) {
  const [draft, setDraft] = useState(() => JSON.stringify(value, null, 2));
  const [problem, setProblem] = useState("");
  useUnread(words.source, problem !== "");
  return (
    <>
      <textarea class="source" aria-label={words.source} spellcheck={false} value={draft} onInput={(event) => {
        setDraft(event.currentTarget.value);
        try {
          onChange(JSON.parse(event.currentTarget.value) as Record<string, unknown>);
          setProblem("");
        } catch (error) {
          setProblem((error as Error).message);
        }
      }} />
      {problem && <p class="problem" role="alert">{problem}</p>}
    </>
  );
}

type Spec = ScannerSpec & Record<string, unknown> & { board_poses?: { left: BoardPose; right: BoardPose } | null };

/** What a device need not say. */
type Unsaid = "scanner_from_device" | "skew" | "distortion";

/** Devices with their poses, of which those of the cameras may follow from a board that both saw. */
function posedDevices(spec: Spec, rig: ReturnType<typeof rigOf> | null): Scanner {
  const devices = ["left", "right", "projector"].map((name): Device => {
    const derived = rig && name !== "projector" ? { scanner_from_device: poseOf(rig[name as "left" | "right"]) } : {};
    // A projector is in the origin if nothing else is said.
    const given = spec[name] as Partial<Pick<Device, Unsaid>> & Omit<Device, "name" | Unsaid>;
    return { ...given, skew: given.skew ?? 0, distortion: given.distortion ?? [0, 0, 0, 0, 0], scanner_from_device: given.scanner_from_device ?? poseOf(new Matrix4()), ...derived, name };
  });
  return { name: spec.name, depth_mm: spec.depth_mm, devices };
}

const BOARD_AXIS_MM = 60;

/** The board that the cameras' poses were found with: its origin and axes, x and y along it. */
function boardLines(board: Matrix4): Group {
  const group = new Group();
  group.name = "board";
  const colours = [0xd55e00, 0x009e73, 0x0072b2];
  colours.forEach((colour, axis) => group.add(lines([0, 0, 0, ...[0, 1, 2].map((i) => (i === axis ? BOARD_AXIS_MM : 0))], colour)));
  group.add(lines([0, 0, 0, BOARD_AXIS_MM, 0, 0, BOARD_AXIS_MM, BOARD_AXIS_MM, 0, BOARD_AXIS_MM, 0, 0, 0, BOARD_AXIS_MM, 0, BOARD_AXIS_MM, BOARD_AXIS_MM, 0, 0, 0, 0, 0, BOARD_AXIS_MM, 0], 0x8a94a0));
  return place(group, board);
}

function boxOf(size: [number, number, number], at: number, colour: number): LineSegments {
  const made = new LineSegments(new EdgesGeometry(new BoxGeometry(...size)), new LineBasicMaterial({ color: colour }));
  made.position.set(0, 0, at);
  return made;
}

function drawScanner(group: Group, spec: Spec, meshes: BodyMeshes): void {
  const { near, best, far } = spec.depth_mm;
  const rig = spec.board_poses ? rigOf(spec.board_poses) : null;
  const posed = posedDevices(spec, rig);
  window.vantage.spec = { devices: posed.devices };
  (spec.body ?? []).forEach((body) => group.add(bodyMesh(body, { colour: 0x56616d }, meshes)));
  group.add(frustums(posed));
  if (rig) group.add(boardLines(rig.board));
  group.add(boxOf([spec.practical_volume_mm[0], spec.practical_volume_mm[1], Math.min(spec.practical_volume_mm[2], far - near)], best, 0xe69f00));
  if (spec.stated_volume_mm) group.add(boxOf(spec.stated_volume_mm, best, 0x009e73));
  for (const depth of [near, best, far]) group.add(boxOf([spec.practical_volume_mm[0], spec.practical_volume_mm[1], 0.1], depth, depth === best ? 0xd55e00 : 0x8a94a0));
}

async function draw(stage: Stage, group: Group, kind: string, spec: Record<string, unknown>): Promise<void> {
  const meshes = kind === "cells" ? {} : await bodyMeshes([...((spec.body ?? []) as Body[]), ...((spec.surfaces ?? []) as Body[])]);
  if (kind === "scanners") drawScanner(group, spec as unknown as Spec, meshes);
  if (kind === "robots") {
    const robot = spec as unknown as Robot;
    const arm = new Arm(robot, undefined, meshes);
    arm.pose([0, 0, 0, 0, 0, 0]);
    group.add(arm.object);
  }
  if (kind === "turntables") {
    const table = spec as unknown as Turntable;
    group.add(plateOf(table));
    (table.body ?? []).forEach((body) => group.add(bodyMesh(body, { colour: 0x8c96a1 }, meshes)));
  }
  if (kind === "cells") {
    const model = await cellModelOf({ cell: spec as unknown as Cell & string });
    group.add(new CellScene(stage, model, null).root);
  }
}

function captions(kind: string, spec: Record<string, unknown>): string {
  if (kind !== "scanners") return "";
  const scanner = spec as unknown as Spec;
  const { near, best, far } = scanner.depth_mm;
  const posed = posedDevices(scanner, scanner.board_poses ? rigOf(scanner.board_poses) : null);
  const devices = posed.devices.map((device) => ({ ...device, scanner_from_device: poseOf(matrixOf(device.scanner_from_device)) }));
  const field = commonField(opticsOf({ ...posed, devices }, { c: 0, d: 0, angle: "" })).map((mm) => lengthIn(mm).toFixed(unit.value === "mm" ? 0 : 1));
  return [`${words.near} ${length(near)}, ${words.best} ${length(best)}, ${words.far} ${length(far)}`,
    `${words.practical} ${sizes(scanner.practical_volume_mm)}`, `${words.common} ${field.join(" × ")} ${lengthUnit()}`,
    scanner.stated_volume_mm && `${words.stated} ${sizes(scanner.stated_volume_mm)}`,
    spec.board_poses && words.board].filter(Boolean).join(" · ");
}

function Drawing({ kind, spec }: { kind: string; spec: Record<string, unknown> }) {
  const [stage, setStage] = useState<Stage | null>(null);
  const box = useRef<Box3 | null>(null);
  const turn = useRef(0);
  useEffect(() => {
    if (!stage) return undefined;
    const mine = (turn.current += 1);
    const timer = setTimeout(() => {
      const group = new Group();
      group.name = "drawing";
      // A document that is being typed may lack anything; the check says what, and the last drawing stays.
      draw(stage, group, kind, spec).then(() => {
        if (turn.current !== mine) return;
        const old = stage.scene.getObjectByName("drawing");
        if (old) { stage.clear(old); stage.scene.remove(old); }
        stage.scene.add(group);
        const first = box.current === null;
        // The floor reaches far beyond what is looked at.
        const floor = group.getObjectByName("floor");
        floor?.removeFromParent();
        box.current = new Box3().setFromObject(group);
        if (floor) group.add(floor);
        if (first) stage.look(box.current, STANDARD_VIEWS.iso!);
        stage.invalidate();
      }, () => {});
    }, 200);
    return () => clearTimeout(timer);
  }, [stage, kind, spec]);
  let caption = "";
  try { caption = captions(kind, spec); } catch { /* An unfinished document has none. */ }
  return (
    <View3d label={words.drawing} name="spec" box={() => box.current} onStage={setStage}>
      <p class="soft">{caption}</p>
      {kind === "cells" && <ReachPanel stage={stage} load={() => cellModelOf({ cell: spec as unknown as Cell & string })} />}
    </View3d>
  );
}


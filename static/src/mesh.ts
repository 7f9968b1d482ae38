// The preview of a mesh: its triangles, the faces of the uploaded file that each stands for, and the worker that holds its tree.
import { request, type Plan } from "./api";
import type { Read } from "./readmesh";
import type { Clearance, ClearanceCell } from "./collide";
import type { ReachMap } from "./reach";
import type { StablePose } from "./stable";
import { text } from "./text";
import type { Ask, Hit, Judgement, Scores } from "./worker";

export interface Preview {
  /** Nine numbers a face, mm, the part's coordinates. */
  positions: Float32Array;
  areas: Float64Array;
  faces: number;
  min: [number, number, number];
  max: [number, number, number];
  /** Faces of the uploaded file that a face stands for. */
  sourceFaces: (face: number) => number[];
  /** The preview's face that stands for one of the file; -1 for none. */
  faceOf: (source: number) => number;
}

interface Gltf {
  accessors: { bufferView: number; count: number; componentType: number; min?: number[]; max?: number[] }[];
  bufferViews: { byteOffset: number; byteLength: number }[];
  meshes: { primitives: { attributes: { POSITION: number }; indices: number;
    extras?: { source_faces: { faces: number; offsets: number } } }[] }[];
}

/** Reads the server's own GLB: one primitive of float positions with indices. */
export function parsePreview(buffer: ArrayBuffer): Preview {
  const header = new DataView(buffer);
  const jsonLength = header.getUint32(12, true);
  const gltf = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 20, jsonLength))) as Gltf;
  const binary = 20 + jsonLength + 8;
  const view = (accessor: number): [number, number] => {
    const { bufferView, count } = gltf.accessors[accessor]!;
    return [binary + gltf.bufferViews[bufferView]!.byteOffset, count];
  };
  const primitive = gltf.meshes[0]!.primitives[0]!;
  const [at, count] = view(primitive.attributes.POSITION);
  const vertices = new Float32Array(buffer, at, 3 * count);
  const [indexAt, indexCount] = view(primitive.indices);
  const indices = new Uint32Array(buffer, indexAt, indexCount);
  const bounds = gltf.accessors[primitive.attributes.POSITION]! as unknown as { min: Preview["min"]; max: Preview["max"] };
  return { ...expanded(vertices, indices), min: bounds.min, max: bounds.max, ...sources(buffer, view, primitive) };
}

function expanded(vertices: Float32Array, indices: Uint32Array): Pick<Preview, "positions" | "areas" | "faces"> {
  const positions = new Float32Array(3 * indices.length);
  for (let corner = 0; corner < indices.length; corner += 1) {
    const [from, to] = [3 * indices[corner]!, 3 * corner];
    positions[to] = vertices[from]!; positions[to + 1] = vertices[from + 1]!; positions[to + 2] = vertices[from + 2]!;
  }
  const faces = indices.length / 3;
  const areas = new Float64Array(faces);
  const p = positions;
  for (let face = 0, i = 0; face < faces; face += 1, i += 9) {
    const ax = p[i + 3]! - p[i]!, ay = p[i + 4]! - p[i + 1]!, az = p[i + 5]! - p[i + 2]!;
    const bx = p[i + 6]! - p[i]!, by = p[i + 7]! - p[i + 1]!, bz = p[i + 8]! - p[i + 2]!;
    const x = ay * bz - az * by, y = az * bx - ax * bz, z = ax * by - ay * bx;
    areas[face] = Math.sqrt(x * x + y * y + z * z) / 2;
  }
  return { positions, areas, faces };
}

function sources(
  buffer: ArrayBuffer, view: (accessor: number) => [number, number], primitive: Gltf["meshes"][0]["primitives"][0],
): Pick<Preview, "sourceFaces" | "faceOf"> {
  const given = primitive.extras?.source_faces;
  if (!given) return { sourceFaces: (face) => [face], faceOf: (face) => face };
  const words = (accessor: number): Uint32Array => {
    const [at, count] = view(accessor);
    return new Uint32Array(buffer, at, count);
  };
  const [offsets, faces] = [words(given.offsets), words(given.faces)];
  let inverse: Map<number, number> | null = null;
  const invert = (): Map<number, number> => {
    const map = new Map<number, number>();
    for (let face = 0; face + 1 < offsets.length; face += 1) {
      for (let i = offsets[face]!; i < offsets[face + 1]!; i += 1) map.set(faces[i]!, face);
    }
    return map;
  };
  return {
    sourceFaces: (face) => [...faces.subarray(offsets[face], offsets[face + 1])],
    faceOf: (source) => (inverse ??= invert()).get(source) ?? -1,
  };
}

// A few previews are kept: going back and forth between jobs of one part reads it once.
const kept = new Map<string, Promise<Preview>>();
const KEPT = 4;

export function preview(meshId: string): Promise<Preview> {
  const known = kept.get(meshId);
  if (known) { kept.delete(meshId); kept.set(meshId, known); return known; }
  const asked = request(`/meshes/${meshId}/preview.glb`).then((response) => response.arrayBuffer()).then(parsePreview);
  asked.catch(() => kept.delete(meshId));
  kept.set(meshId, asked);
  if (kept.size > KEPT) kept.delete(kept.keys().next().value!);
  return asked;
}

/** The fixture that holds the part of a plan, in the part's coordinates. */
export const fixtureOf = async ({ params: { part } }: Plan): Promise<Preview | null> => (part.fixture_mesh ? preview(part.fixture_mesh) : null);

export async function coverageBytes(jobId: string): Promise<Uint8Array> {
  return new Uint8Array(await (await request(`/jobs/${jobId}/coverage.bin`)).arrayBuffer());
}

/** A worker and what it has been asked. It begins with the first question; one that could not be loaded, with the next one. */
class Asked {
  private worker: Worker | null = null;
  protected isClosed = false;
  private readonly waiting = new Map<number, { resolve: (value: never) => void; reject: (error: Error) => void;
    onProgress?: (share: number) => void }>();
  private next = 1;

  /** `first`: what each worker is told before anything else. */
  constructor(private readonly first?: () => [Ask, Transferable[]]) {}

  protected start(): Worker {
    if (this.worker) return this.worker;
    const worker = this.worker = new Worker(new URL("./worker.js", import.meta.url), { type: "module" });
    worker.onmessage = ({ data }) => {
      const waiting = this.waiting.get(data.id);
      if ("progress" in data) { waiting?.onProgress?.(data.progress); return; }
      this.waiting.delete(data.id);
      if ("error" in data) waiting?.reject(new Error(data.error));
      else waiting?.resolve(data.value as never);
    };
    worker.onerror = () => {
      worker.terminate();
      this.worker = null;
      this.waiting.forEach(({ reject }) => reject(new Error(text.viewGone)));
      this.waiting.clear();
    };
    if (this.first) void this.send(...this.first()).catch(() => {});
    return worker;
  }

  send<T>(ask: Ask, transfer: Transferable[] = [], onProgress?: (share: number) => void): Promise<T> {
    return new Promise((resolve, reject) => {
      // Nobody waits for the answer any more.
      if (this.isClosed) return;
      const worker = this.start();
      const id = this.next;
      this.next += 1;
      this.waiting.set(id, { resolve, reject, ...(onProgress && { onProgress }) });
      worker.postMessage({ id, ask }, transfer);
    });
  }

  close = (): void => {
    this.isClosed = true;
    this.worker?.terminate();
  };
}

/** The worker with the bodies of one cell. */
export class ClearanceTracer extends Asked {
  constructor(given: ClearanceCell) {
    super(() => [{ kind: "cell", given }, []]);
  }

  at = (configurations: number[][], onProgress?: (share: number) => void): Promise<(Clearance | null)[]> =>
    this.send({ kind: "clearances", configurations }, [], onProgress);
}

/** A worker that counts the reach of a cell. */
export class ReachCounter extends Asked {
  count = (given: ClearanceCell, edge: number, onProgress: (share: number) => void): Promise<ReachMap> =>
    this.send({ kind: "reach", given, edge }, [], onProgress);
}

/** The worker with the tree of one mesh. */
export class Tracer extends Asked {
  /** `fixture`: what hides the mesh besides itself. */
  constructor(positions: Float32Array, fixture: Float32Array | null = null) {
    super(() => {
      const copy = positions.slice();
      return [{ kind: "load", positions: copy, fixture }, [copy.buffer]];
    });
  }

  /** Begins ahead of the first question. */
  begin = (): void => { if (!this.isClosed) this.start(); };

  pick = (origin: number[], direction: number[], section: number[] | null): Promise<Hit | null> =>
    this.send({ kind: "pick", origin, direction, section });
  judge = (ask: Omit<Extract<Ask, { kind: "judge" }>, "kind">): Promise<Judgement[]> => this.send({ kind: "judge", ...ask });
  score = (ask: Omit<Extract<Ask, { kind: "score" }>, "kind">, onProgress: (share: number) => void): Promise<Scores | null> =>
    this.send({ kind: "score", ...ask }, [], onProgress);
  flood = (face: number, maxDeg: number): Promise<Int32Array> => this.send({ kind: "flood", face, maxDeg });
  near = (point: number[], radius: number, normal: number[]): Promise<Int32Array> =>
    this.send({ kind: "near", point, radius, normal });
  box = (min: number[], max: number[]): Promise<Int32Array> => this.send({ kind: "box", min, max });
}

/** Asks a worker of its own, which ends with the answer. */
function once<T>(ask: Ask, transfer: Transferable[]): Promise<T> {
  const worker = new Asked();
  return worker.send<T>(ask, transfer).finally(worker.close);
}

/** Reads a file that is not sent yet. */
export const readFile = async (file: File): Promise<Read> => {
  const buffer = await file.arrayBuffer();
  return once<Read>({ kind: "read", file: buffer }, [buffer]);
};

/** Ways in which a part can stand. */
export const stablePoses = (positions: Float32Array): Promise<StablePose[]> => {
  const copy = positions.slice();
  return once({ kind: "rest", positions: copy }, [copy.buffer]);
};

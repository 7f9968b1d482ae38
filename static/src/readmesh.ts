// Triangles of a file that is not sent yet, for a look at it and its size: STL, OBJ and PLY. The server reads the file anew and
// says what is wrong with it; here a file that cannot be read is only not drawn.

export interface Read { positions: Float32Array; faces: number; min: number[]; max: number[]; isThinned: boolean }

/** More triangles are not drawn before the upload: every n-th is. */
const MAX_DRAWN = 300_000;

class Triangles {
  faces = 0;
  readonly min = [Infinity, Infinity, Infinity];
  readonly max = [-Infinity, -Infinity, -Infinity];
  private readonly kept: number[] = [];

  constructor(private readonly every: number) {}

  add(corners: number[]): void {
    for (let i = 0; i < 9; i += 1) {
      const value = corners[i]!;
      if (!Number.isFinite(value)) return;
      if (value < this.min[i % 3]!) this.min[i % 3] = value;
      if (value > this.max[i % 3]!) this.max[i % 3] = value;
    }
    if (this.faces % this.every === 0) for (let i = 0; i < 9; i += 1) this.kept.push(corners[i]!);
    this.faces += 1;
  }

  polygon(points: number[][], corners: number[]): void {
    for (let i = 2; i < corners.length; i += 1) {
      const triangle = [corners[0]!, corners[i - 1]!, corners[i]!].flatMap((corner) => points[corner] ?? [NaN, NaN, NaN]);
      this.add(triangle);
    }
  }

  done(): Read {
    if (this.faces === 0) throw new Error("no triangles");
    return { positions: new Float32Array(this.kept), faces: this.faces, min: this.min, max: this.max, isThinned: this.every > 1 };
  }
}

const everyOf = (faces: number): number => Math.max(1, Math.ceil(faces / MAX_DRAWN));

function stlBinary(view: DataView): Read {
  const count = view.getUint32(80, true);
  const made = new Triangles(everyOf(count));
  const corners = new Array<number>(9);
  for (let at = 84; at + 50 <= view.byteLength && made.faces < count; at += 50) {
    for (let i = 0; i < 9; i += 1) corners[i] = view.getFloat32(at + 12 + 4 * i, true);
    made.add(corners);
  }
  return made.done();
}

function stlText(text: string): Read {
  const made = new Triangles(everyOf(text.length / 250));
  let corners: number[] = [];
  for (const [, x, y, z] of text.matchAll(/vertex\s+(\S+)\s+(\S+)\s+(\S+)/gi)) {
    corners.push(Number(x), Number(y), Number(z));
    if (corners.length === 9) { made.add(corners); corners = []; }
  }
  return made.done();
}

function obj(text: string): Read {
  const points: number[][] = [];
  const made = new Triangles(everyOf(text.length / 60));
  for (const line of text.split("\n")) {
    const words = line.trim().split(/\s+/);
    if (words[0] === "v") points.push(words.slice(1, 4).map(Number));
    if (words[0] !== "f") continue;
    made.polygon(points, words.slice(1).map((word) => {
      const index = parseInt(word, 10);
      return index < 0 ? points.length + index : index - 1;
    }));
  }
  return made.done();
}

interface Property { name: string; type: string; countType?: string }
interface Element { name: string; count: number; properties: Property[] }
const SIZES: Record<string, number> = { char: 1, uchar: 1, int8: 1, uint8: 1, short: 2, ushort: 2, int16: 2, uint16: 2, int: 4,
  uint: 4, int32: 4, uint32: 4, float: 4, float32: 4, double: 8, float64: 8 };

function plyHeader(text: string): { format: string; elements: Element[]; size: number } {
  const end = text.indexOf("end_header");
  const elements: Element[] = [];
  let format = "";
  for (const line of text.slice(0, end).split(/\r?\n/)) {
    const words = line.trim().split(/\s+/);
    if (words[0] === "format") format = words[1]!;
    if (words[0] === "element") elements.push({ name: words[1]!, count: Number(words[2]), properties: [] });
    if (words[0] === "property") {
      const isList = words[1] === "list";
      elements.at(-1)!.properties.push({ name: words.at(-1)!, type: words[isList ? 3 : 1]!, ...(isList && { countType: words[2]! }) });
    }
  }
  return { format, elements, size: text.indexOf("\n", end) + 1 };
}

function ply(buffer: ArrayBuffer): Read {
  const bytes = new Uint8Array(buffer);
  const { format, elements, size } = plyHeader(new TextDecoder("latin1").decode(bytes.subarray(0, 65_536)));
  const view = new DataView(buffer);
  const isLittle = format === "binary_little_endian";
  const words = format === "ascii" ? new TextDecoder("latin1").decode(bytes.subarray(size)).split(/\s+/) : null;
  let at = words ? (words[0] === "" ? 1 : 0) : size;
  const next = (type: string): number => {
    if (words) { at += 1; return Number(words[at - 1]); }
    const bytesOf = SIZES[type]!;
    at += bytesOf;
    const from = at - bytesOf;
    if (/double|float64/.test(type)) return view.getFloat64(from, isLittle);
    if (/float/.test(type)) return view.getFloat32(from, isLittle);
    const isUnsigned = type.startsWith("u");
    if (bytesOf === 1) return isUnsigned ? view.getUint8(from) : view.getInt8(from);
    if (bytesOf === 2) return isUnsigned ? view.getUint16(from, isLittle) : view.getInt16(from, isLittle);
    return isUnsigned ? view.getUint32(from, isLittle) : view.getInt32(from, isLittle);
  };
  return plyTriangles(elements, next);
}

function plyTriangles(elements: Element[], next: (type: string) => number): Read {
  const points: number[][] = [];
  const made = new Triangles(everyOf(elements.find((element) => element.name === "face")?.count ?? 0));
  for (const element of elements) {
    const place = ["x", "y", "z"].map((name) => element.properties.findIndex((property) => property.name === name));
    for (let i = 0; i < element.count; i += 1) {
      const values = element.properties.map(({ type, countType }) =>
        (countType ? Array.from({ length: next(countType) }, () => next(type)) : next(type)));
      if (element.name === "vertex") points.push(place.map((at) => values[at] as number));
      const corners = element.name === "face" && values.find(Array.isArray);
      if (corners) made.polygon(points, corners as number[]);
    }
  }
  return made.done();
}

export function readMesh(buffer: ArrayBuffer): Read {
  const start = new TextDecoder("latin1").decode(new Uint8Array(buffer, 0, Math.min(1024, buffer.byteLength)));
  if (start.startsWith("ply")) return ply(buffer);
  const view = new DataView(buffer);
  if (buffer.byteLength >= 84 && buffer.byteLength >= 84 + 50 * view.getUint32(80, true) && view.getUint32(80, true) > 0) return stlBinary(view);
  const text = new TextDecoder().decode(buffer);
  return /^\s*solid/.test(text) ? stlText(text) : obj(text);
}

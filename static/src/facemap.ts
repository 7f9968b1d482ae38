// What an inspection knows of each face of the preview, from its tables by face of the uploaded file; and the samples of its point cloud.
import { ask, request, type InspectionJob, type Job } from "./api";
import { preview, type Preview } from "./mesh";
import { BELOW, diverging, lossColour, MATCH, UNASKED, WHOLE, UNMEASURED, type Rgb } from "./palette";

export type MapKind = "losses" | "coverage" | "deviation";
export type Match = "both" | "lost" | "gained" | "neither" | "not_asked";

/** Areas, mm², and the deviation, mm, by face of the preview. */
export interface FaceMap {
  mesh: Preview; asked: Float64Array; planned: Float64Array; measured: Float64Array; lost: Float64Array;
  /** Cause of the largest lost area, an index of `causes`; -1 for none. */
  cause: Int8Array; causes: string[];
  /** Area that was compared with the model, and the mean deviation and expanded uncertainty over it. */
  compared: Float64Array; deviation: Float64Array; uncertainty: Float64Array;
}

async function rowsOf(path: string, take: (cells: string[]) => void): Promise<void> {
  const table = await (await request(path)).text();
  for (let from = table.indexOf("\n") + 1; from > 0 && from < table.length;) {
    const to = table.indexOf("\n", from);
    const end = to < 0 ? table.length : to;
    take(table.slice(from, end).trimEnd().split(","));
    from = end + 1;
  }
}

export async function faceMapOf({ id, job_id: jobId }: InspectionJob): Promise<FaceMap> {
  const mesh = await preview((await ask<Job>(`/jobs/${jobId}`)).mesh_id);
  const sums = (): Float64Array => new Float64Array(mesh.faces);
  const map: FaceMap = { mesh, asked: sums(), planned: sums(), measured: sums(), lost: sums(), cause: new Int8Array(mesh.faces).fill(-1), causes: [],
    compared: sums(), deviation: sums(), uncertainty: sums() };
  const largest = sums();
  await Promise.all([
    rowsOf(`/inspections/${id}/losses?format=csv`, (cells) => {
      const [source, asked, planned, measured, lost] = cells.map(Number) as [number, number, number, number, number];
      const face = mesh.faceOf(source);
      if (face < 0) return;
      map.asked[face]! += asked;
      map.planned[face]! += planned;
      map.measured[face]! += measured;
      map.lost[face]! += lost;
      if (!cells[5] || lost <= largest[face]!) return;
      largest[face] = lost;
      if (!map.causes.includes(cells[5])) map.causes.push(cells[5]);
      map.cause[face] = map.causes.indexOf(cells[5]);
    }),
    rowsOf(`/inspections/${id}/deviation?format=csv`, (cells) => {
      const [source, area, , mean, , expanded] = cells.map(Number) as [number, number, number, number, number, number];
      const face = mesh.faceOf(source);
      if (face < 0) return;
      map.compared[face]! += area;
      map.deviation[face]! += area * mean;
      map.uncertainty[face]! += area * expanded;
    }),
  ]);
  map.compared.forEach((area, face) => {
    if (area > 0) { map.deviation[face]! /= area; map.uncertainty[face]! /= area; }
  });
  return map;
}

/** What most of a face is. */
export function matchOf({ asked, planned, measured, lost }: FaceMap, face: number): Match {
  if (!(asked[face]! > 0)) return "not_asked";
  const both = planned[face]! - lost[face]!;
  const gained = Math.max(0, measured[face]! - both);
  const shares: [Match, number][] = [["both", both], ["lost", lost[face]!], ["gained", gained], ["neither", asked[face]! - planned[face]! - gained]];
  return shares.reduce((most, one) => (one[1] > most[1] ? one : most))[0];
}

/** Colour of a face in a map; deviations are told apart up to `limit`, mm. */
export function painterOf(map: FaceMap, kind: MapKind, limit: number): (face: number) => Rgb {
  if (kind === "coverage") return (face) => MATCH[matchOf(map, face)]!;
  if (kind === "deviation") return (face) => (map.compared[face]! > 0 ? diverging(map.deviation[face]! / limit) : UNMEASURED);
  return (face) => {
    const match = matchOf(map, face);
    if (match === "lost") return lossColour(map.causes[map.cause[face]!] ?? "");
    return match === "not_asked" ? UNASKED : match === "neither" ? BELOW : WHOLE;
  };
}

/** Samples of the surface, part frame, mm. */
export interface Cloud { positions: Float32Array; normals: Float32Array; deviations: Float32Array; count: number }

const BYTES_OF_SAMPLE = 35;

/** Reads the server's own PLY: x, y, z, normal, deviation, expanded uncertainty as floats, and three bytes of colour. */
export function parseCloud(buffer: ArrayBuffer): Cloud {
  const head = new TextDecoder("latin1").decode(new Uint8Array(buffer, 0, Math.min(2000, buffer.byteLength)));
  const end = "end_header\n";
  const at = head.indexOf(end) + end.length;
  const count = Number(/element vertex (\d+)/.exec(head)?.[1] ?? 0);
  const view = new DataView(buffer, at);
  const [positions, normals, deviations] = [new Float32Array(3 * count), new Float32Array(3 * count), new Float32Array(count)];
  for (let i = 0; i < count; i += 1) {
    for (let axis = 0; axis < 3; axis += 1) {
      positions[3 * i + axis] = view.getFloat32(BYTES_OF_SAMPLE * i + 4 * axis, true);
      normals[3 * i + axis] = view.getFloat32(BYTES_OF_SAMPLE * i + 12 + 4 * axis, true);
    }
    deviations[i] = view.getFloat32(BYTES_OF_SAMPLE * i + 24, true);
  }
  return { positions, normals, deviations, count };
}

/** True where the samples are so much finer than the faces that these would hide how the surface deviates. */
export const needsCloud = (map: FaceMap, { files }: InspectionJob): boolean =>
  (files.find(({ name }) => name === "deviation.ply")?.size_bytes ?? 0) / BYTES_OF_SAMPLE > 3 * map.compared.reduce((n, area) => n + (area > 0 ? 1 : 0), 0);

export const cloudOf = async (id: string): Promise<Cloud> => parseCloud(await (await request(`/inspections/${id}/deviation?format=ply`)).arrayBuffer());

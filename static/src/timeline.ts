// A program as positions over time: the path of each move exactly, the speed along it as a trapezoid.
import type { Program, Step } from "./api";

export interface Span { step: number; op: Step["op"]; from: number; to: number; path: number[][]; lengths: number[]; viewpoint?: number | undefined }

export interface Timeline { spans: Span[]; total: number }

/** Share of a move that is spent on each ramp; the program states the move's time, not its ramps. */
const RAMP = 0.2;

export function timelineOf(program: Program): Timeline {
  let at = [...program.home_deg];
  let time = 0;
  const spans = program.steps.map((step, index): Span => {
    const secs = step.op === "move_joints" ? step.duration_secs! : step.op === "settle" ? step.secs! : step.capture_secs ?? 0;
    const target = step.op === "move_joints" ? [...step.joints_deg!, step.table_angle_deg!] : at;
    const path = step.op === "move_joints" ? [at, ...(step.via ?? []), target] : [at];
    const lengths = [0];
    for (let i = 1; i < path.length; i += 1) lengths.push(lengths[i - 1]! + Math.max(...path[i]!.map((value, j) => Math.abs(value - path[i - 1]![j]!))));
    const span: Span = { step: index, op: step.op, from: time, to: time + secs, path, lengths, viewpoint: step.viewpoint };
    at = target;
    time += secs;
    return span;
  });
  return { spans, total: time };
}

export function spanAt({ spans }: Timeline, time: number): Span | undefined {
  let [low, high] = [0, spans.length - 1];
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (spans[middle]!.from <= time) low = middle; else high = middle - 1;
  }
  return spans[low];
}

/** Share of the path after a share of the time, with ramps at both ends. */
function eased(share: number): number {
  const top = 1 / (1 - RAMP);
  if (share < RAMP) return (top * share * share) / (2 * RAMP);
  if (share > 1 - RAMP) return 1 - (top * (1 - share) ** 2) / (2 * RAMP);
  return top * (share - RAMP / 2);
}

/** Joints and table angle at a time, degrees. */
export function configurationAt(timeline: Timeline, time: number): number[] {
  const span = spanAt(timeline, time);
  if (!span) return [];
  const whole = span.lengths.at(-1)!;
  if (span.path.length < 2 || whole === 0) return span.path.at(-1)!;
  const share = Math.max(0, Math.min(1, (time - span.from) / Math.max(1e-9, span.to - span.from)));
  const along = eased(share) * whole;
  let i = 1;
  while (i < span.lengths.length - 1 && span.lengths[i]! < along) i += 1;
  const [from, to] = [span.lengths[i - 1]!, span.lengths[i]!];
  const part = to > from ? (along - from) / (to - from) : 1;
  return span.path[i]!.map((value, j) => span.path[i - 1]![j]! + part * (value - span.path[i - 1]![j]!));
}

/** Points for plots: the corners of the path, and some on the ramps between. */
export function sampled(timeline: Timeline, count: number): { times: number[]; values: number[][] } {
  const times = Array.from({ length: count + 1 }, (_, i) => (timeline.total * i) / count);
  const rows = times.map((time) => configurationAt(timeline, time));
  return { times, values: Array.from({ length: 7 }, (_, joint) => rows.map((row) => row[joint] ?? 0)) };
}

// Plots by uPlot, in the colours of the page.
import uPlot from "uplot";
import { useEffect, useRef } from "preact/hooks";
import { isDark } from "./settings";
import { LINES } from "./palette";

export interface Line { label: string; values: (number | null)[]; colour?: string; isStepped?: boolean; isDashed?: boolean; isFaint?: boolean; isPoints?: boolean }

interface Props {
  title: string; x: number[]; lines: Line[]; xLabel: string; yLabel: string; height?: number; percent?: boolean;
  yRange?: [number, number]; /** What is 0 or more is drawn from 0 to this at least. */ least?: number; cursor?: number; onPick?: (x: number) => void; points?: boolean; legend?: boolean;
  /** What is counted along x has no halves. */
  isCounted?: boolean;
}

const COUNTS = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000];

/** A number without a row of zeros, for which there is no room beside an axis. */
const shortest = (value: number): string => (value !== 0 && Math.abs(value) < 1e-3 ? value.toExponential() : String(value));

function optionsOf(props: Props, width: number, dark: boolean): uPlot.Options {
  const { least } = props;
  const ink = dark ? "#a9b6c4" : "#4a5563";
  const grid = { stroke: dark ? "#2b343f" : "#e2e6eb", width: 1 };
  const axis = { stroke: ink, grid, ticks: grid, font: "11px system-ui, sans-serif", labelFont: "11px system-ui, sans-serif", labelSize: 16 };
  const stepped = uPlot.paths.stepped!({ align: 1 });
  return {
    width, height: props.height ?? 190,
    legend: { show: props.legend ?? props.lines.length > 1, live: false },
    cursor: { y: false, drag: { x: false, y: false } },
    scales: { x: { time: false }, y: props.yRange ? { range: props.yRange } : least ? { range: (_: uPlot, __: number | null, most: number | null) => [0, Math.max(least, 1.1 * (most ?? 0))] } : {} },
    axes: [
      { ...axis, label: props.xLabel, size: 28, ...(props.isCounted && { incrs: COUNTS }) },
      { ...axis, label: props.yLabel, size: 44, values: (_: uPlot, ticks: number[]) =>
        ticks.map((tick) => (props.percent ? `${Math.round(100 * tick)} %` : shortest(Number(tick.toPrecision(6))))) },
    ],
    series: [{}, ...props.lines.map((line, i) => ({
      label: line.label, stroke: line.colour ?? LINES[i % LINES.length]!, width: line.isFaint ? 1 : 2,
      points: { show: Boolean((props.points && !line.isFaint) || line.isPoints), ...(line.isPoints && { size: 6 }) }, ...(line.isPoints && { paths: () => null }), ...(line.isStepped && { paths: stepped }), ...(line.isDashed && { dash: [5, 4] }),
    }))],
    hooks: { draw: [(plot) => mark(plot, props.cursor, dark)] },
  };
}

/** Line at the present time. */
function mark(plot: uPlot, at: number | undefined, dark: boolean): void {
  if (at === undefined) return;
  const x = plot.valToPos(at, "x", true);
  plot.ctx.fillStyle = dark ? "#f2b866" : "#b35c00";
  plot.ctx.fillRect(x - 1, plot.bbox.top, 2, plot.bbox.height);
}

export function Chart(props: Props) {
  const holder = useRef<HTMLDivElement>(null);
  const plot = useRef<uPlot | null>(null);
  const latest = useRef(props);
  latest.current = props;
  const dark = isDark.value;
  const shape = `${props.lines.map((line) => line.label).join()}|${props.yLabel}|${props.xLabel}|${props.yRange?.join() ?? ""}`;
  useEffect(() => {
    const element = holder.current!;
    const data = [props.x, ...props.lines.map((line) => line.values)] as uPlot.AlignedData;
    const options = optionsOf(props, element.clientWidth || 320, dark);
    options.hooks!.draw = [(made) => mark(made, latest.current.cursor, dark)];
    const made = new uPlot(options, data, element);
    made.over.addEventListener("click", () => {
      const left = made.cursor.left ?? -1;
      if (left >= 0) latest.current.onPick?.(made.posToVal(left, "x"));
    });
    plot.current = made;
    const resizing = new ResizeObserver(() => {
      if (element.clientWidth > 0) made.setSize({ width: element.clientWidth, height: latest.current.height ?? 190 });
    });
    resizing.observe(element);
    return () => { resizing.disconnect(); made.destroy(); plot.current = null; };
  }, [shape, dark]);
  useEffect(() => {
    plot.current?.setData([props.x, ...props.lines.map((line) => line.values)] as uPlot.AlignedData);
  }, [props.x, props.lines]);
  useEffect(() => { plot.current?.redraw(false); }, [props.cursor]);
  return (
    <figure class="chart">
      <figcaption>{props.title}</figcaption>
      <div ref={holder} role="img" aria-label={summary(props)} />
    </figure>
  );
}

/** Plot in words, for readers who do not see it. */
function summary({ title, lines, percent, yLabel }: Props): string {
  const show = (value: number): string => (percent ? `${(100 * value).toFixed(1)} %` : `${value.toPrecision(4)} ${yLabel}`);
  const ends = lines.filter((line) => !line.isFaint).map((line) => {
    const values = line.values.filter((value): value is number => value !== null);
    return values.length ? `${line.label}: ${show(values[0]!)} to ${show(values.at(-1)!)}` : line.label;
  });
  return `${title}. ${ends.join("; ")}`;
}

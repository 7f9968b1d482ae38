// What the reader chose for this browser: unit of length, colours; and the place in the page, which its address holds.
import { batch, computed, effect, signal } from "@preact/signals";
import { text } from "./text";

export type Theme = "auto" | "light" | "dark";
export type Unit = "mm" | "inch";

export const theme = signal<Theme>((localStorage.getItem("vantage-theme") as Theme | null) ?? "auto");
export const unit = signal<Unit>((localStorage.getItem("vantage-unit") as Unit | null) ?? "mm");
const darkPreferred = matchMedia("(prefers-color-scheme: dark)");
const systemDark = signal(darkPreferred.matches);
darkPreferred.addEventListener("change", (event) => { systemDark.value = event.matches; });
export const isDark = computed(() => (theme.value === "auto" ? systemDark.value : theme.value === "dark"));

effect(() => {
  localStorage.setItem("vantage-theme", theme.value);
  document.documentElement.dataset.theme = isDark.value ? "dark" : "light";
});
effect(() => localStorage.setItem("vantage-unit", unit.value));

/** The address within the page: `#/jobs/ID/plan?view=3` is path `["jobs", "ID", "plan"]` and query `view=3`. */
export interface Place { path: string[]; query: URLSearchParams }

/** A part of an address; as it is where its escapes are damaged. */
function decoded(part: string): string {
  try {
    return decodeURIComponent(part);
  } catch {
    return part;
  }
}

function placeOf(hash: string): Place {
  const [path = "", query = ""] = hash.replace(/^#\/?/, "").split("?");
  return { path: path.split("/").filter(Boolean).map(decoded), query: new URLSearchParams(query) };
}

export const place = signal<Place>(placeOf(location.hash));
/** Counts the addresses that were entered, opened or gone back to: what is shown follows them. */
export const visits = signal(0);
addEventListener("hashchange", () => batch(() => { place.value = placeOf(location.hash); visits.value += 1; }));

export function hrefOf(path: string[], query: Record<string, string | undefined> = {}): string {
  const given = Object.entries(query).filter((entry): entry is [string, string] => Boolean(entry[1]));
  const asked = new URLSearchParams(given).toString();
  return `#/${path.map(encodeURIComponent).join("/")}${asked ? `?${asked}` : ""}`;
}

// Browsers ignore an address that is changed more than some 20 times a second, as a slider would.
const WRITE_MS = 150;
let written = 0;
let waiting: ReturnType<typeof setTimeout> | undefined;

/** Changes parts of the query of the present address: a selection has an address, but is no step back of the browser. */
export function setQuery(changes: Record<string, string | undefined>): void {
  const { path, query } = place.peek();
  const hash = hrefOf(path, { ...Object.fromEntries(query), ...changes });
  if (hash === hrefOf(path, Object.fromEntries(query))) return;
  place.value = placeOf(hash);
  clearTimeout(waiting);
  const before = location.hash;
  const write = (): void => {
    // The reader may have gone elsewhere meanwhile.
    if (location.hash !== before) return;
    written = Date.now();
    history.replaceState(null, "", hash);
  };
  const wait = written + WRITE_MS - Date.now();
  if (wait <= 0) write();
  else waiting = setTimeout(write, wait);
}

export function goTo(hash: string): void {
  location.hash = hash;
}

const MM_PER_INCH = 25.4;

/** A number as text with the sign that reports have. */
const signed = (shown: string): string => shown.replace("-", "−");

/** A number with the thousands apart, as reports have it. */
export const count = (value: number, places = 0): string =>
  signed(value.toLocaleString("en", { minimumFractionDigits: places, maximumFractionDigits: places, signDisplay: "negative" }).replaceAll(",", "\u202f"));

/** Digits that a reader can use: three significant ones below a thousand. */
function digits(value: number, decimals: number): string {
  const size = Math.abs(value);
  return count(value, size >= 1000 ? 0 : size >= 100 ? Math.min(1, decimals) : decimals);
}

export const lengthIn = (mm: number): number => (unit.value === "mm" ? mm : mm / MM_PER_INCH);
export const lengthUnit = (): string => (unit.value === "mm" ? "mm" : "in");
export const fromShown = (value: number): number => (unit.value === "mm" ? value : value * MM_PER_INCH);
export const areaIn = (mm2: number): number => (unit.value === "mm" ? mm2 : mm2 / MM_PER_INCH ** 2);
/** A point, without its unit. */
export const point = (mm: readonly number[]): string => mm.map((value) => fixed(lengthIn(value), unit.value === "mm" ? 1 : 3)).join(", ");
export const length = (mm: number): string => `${digits(lengthIn(mm), unit.value === "mm" ? 1 : 3)}\u00a0${lengthUnit()}`;
/** Decimals of a number, of which 0 has no sign. */
export function fixed(value: number, decimals: number): string {
  const shown = value.toFixed(decimals);
  return Number(shown) === 0 ? shown.replace("-", "") : signed(shown);
}
/** A length that is compared with a tolerance. */
export const fine = (mm: number): string => `${fixed(lengthIn(mm), unit.value === "mm" ? 3 : 4)}\u00a0${lengthUnit()}`;
/** The limits of a tolerance zone of this width, as a drawing has them; in mm with up to six decimals, so that none is rounded to another. */
export function limits(widthMm: number): string {
  const limit = lengthIn(widthMm / 2);
  const shown = unit.value === "mm" ? Math.max(3, String(Number(limit.toFixed(6))).split(".")[1]?.length ?? 0) : 4;
  return `±${nonzero(limit, shown)}\u00a0${lengthUnit()}`;
}
export const area = (mm2: number): string =>
  `${digits(areaIn(mm2), unit.value === "mm" ? 1 : 3)}\u00a0${lengthUnit()}²`;
export const sizes = (mm: readonly number[]): string =>
  `${mm.map((value) => digits(lengthIn(value), unit.value === "mm" ? 1 : 3)).join(" × ")} ${lengthUnit()}`;
/** Decimals of a number; with as many more, at most twelve, as show two digits where it would be shown as 0 and is not. */
export function nonzero(value: number, decimals: number): string {
  const shown = fixed(value, decimals);
  return value === 0 || Number(value.toFixed(decimals)) !== 0 ? shown : fixed(value, Math.min(12, 1 - Math.floor(Math.log10(Math.abs(value)))));
}
/** What may be lacking of a whole, or be left of nothing: sums of areas are not exact to the last bit. */
const SUM_SLACK = 1e-9;
/** A share, as the server's sentences have it (`wire/words.rs`): above 0 it is not shown as 0, below a limit not as that. */
export function percent(share: number, decimals = 1, limit = 1): string {
  const [shown, ofLimit] = [fixed(100 * share, decimals), fixed(100 * limit, decimals)];
  if (share > SUM_SLACK && Number(shown) === 0) return `${nonzero(100 * share, decimals)}\u00a0%`;
  const steps = 10 ** decimals;
  return share < limit - SUM_SLACK && shown === ofLimit ? `${fixed(Math.floor(100 * share * steps) / steps, decimals)}\u00a0%` : `${shown}\u00a0%`;
}
/** Difference of shares, percentage points. */
export function points(difference: number): string {
  const shown = fixed(100 * difference, 2);
  return difference > 0 && Number(shown) !== 0 ? `+${shown}` : shown;
}
export const seconds = (secs: number): string => {
  if (secs < 90) return `${secs < 10 ? secs.toFixed(1) : secs.toFixed(0)}\u00a0s`;
  const [all, isLong] = [Math.round(secs < 3600 ? secs : secs / 60), secs >= 3600];
  return [Math.floor(all / 60), isLong ? "h" : "min", all % 60, isLong ? "min" : "s"].join("\u00a0");
};
export const fileSize = (bytes: number | null | undefined): string =>
  (bytes == null ? text.none : bytes < 1e6 ? `${count(bytes / 1e3, bytes < 1e4 ? 1 : 0)} kB` : `${(bytes / 1e6).toFixed(1)} MB`);
export const degrees = (deg: number): string => `${fixed(deg, 1)}°`;
export const when = (time: string): string => new Date(time).toLocaleString();
/** Time zone of the browser, in which times are shown. */
export const zone = new Intl.DateTimeFormat().resolvedOptions().timeZone;
/** A time, or the heading above times, with their zone. */
export const zoned = (shown: string): string => `${shown} (${zone})`;

/** A clause of the server as a sentence of its own. */
export const sentence = (clause: string): string => `${clause.charAt(0).toUpperCase()}${clause.slice(1)}${/[.!?]$/.test(clause) ? "" : "."}`;

/** A sentence of the server without the options of the command line, which a button stands for here; in brackets, parameters stay. */
export const withoutOptions = (sentence: string): string => sentence.replace(/(?:; to plan for that)?:?(?: --set (?:'[^']*'|[^\s;]+))+| \(--up [^)]*\)/g, "").replaceAll("(--set ", "(");

// Small parts of which the views are made.
import { signal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { useEffect, useState } from "preact/hooks";
import { stream } from "./jobs";
import { text } from "./text";

/** What went wrong last, said once at the top. */
export const message = signal("");

export async function guarded<T>(work: () => Promise<T>): Promise<T | undefined> {
  message.value = "";
  try {
    return await work();
  } catch (error) {
    message.value = (error as Error).message || text.failed;
    return undefined;
  }
}

export function Button({ onClick, children, kind = "", ...rest }: {
  onClick: () => unknown; children: ComponentChildren; kind?: string; disabled?: boolean; title?: string; "aria-pressed"?: boolean;
  "aria-label"?: string; class?: string;
}) {
  const [busy, setBusy] = useState(false);
  const click = (): void => {
    const result = onClick();
    if (!(result instanceof Promise)) return;
    setBusy(true);
    void guarded(() => result).finally(() => setBusy(false));
  };
  return <button type="button" {...rest} class={`${kind} ${rest.class ?? ""}`} disabled={rest.disabled || busy} onClick={click}>{children}</button>;
}

/** A name of an address, or the first where it is none of the names. */
export const known = (names: object, name: string | null): string => (name !== null && Object.hasOwn(names, name) ? name : Object.keys(names)[0]!);

/** Tabs with arrow keys (WAI-ARIA authoring practices, tabs pattern). */
export function Tabs({ names, chosen, onChoose, label }: {
  names: Record<string, string>; chosen: string; onChoose: (name: string) => void; label: string;
}) {
  const keys = Object.keys(names);
  const move = (event: KeyboardEvent): void => {
    const step = event.key === "ArrowRight" ? 1 : event.key === "ArrowLeft" ? -1 : 0;
    if (!step) return;
    event.preventDefault();
    const next = keys[(keys.indexOf(chosen) + step + keys.length) % keys.length]!;
    onChoose(next);
    (event.currentTarget as HTMLElement).querySelector<HTMLElement>(`[data-tab="${next}"]`)?.focus();
  };
  return (
    <div class="tabs" role="tablist" aria-label={label} onKeyDown={move}>
      {keys.map((name) => (
        <button type="button" role="tab" data-tab={name} aria-selected={name === chosen} tabIndex={name === chosen ? 0 : -1}
          onClick={() => onChoose(name)}>{names[name]}</button>
      ))}
    </div>
  );
}

export function Select({ label, value, options, onChange, hideLabel, ...rest }: {
  label: string; value: string; options: [string, string][]; onChange: (value: string) => void; hideLabel?: boolean; required?: boolean;
  name?: string; disabled?: boolean;
}) {
  return (
    <label class={hideLabel ? "quiet" : ""}>
      <span>{label}</span>
      <select {...rest} value={value} onChange={(event) => onChange(event.currentTarget.value)}>
        {options.map(([key, name]) => <option key={key} value={key}>{name}</option>)}
      </select>
    </label>
  );
}

export function Slider({ label, value, min, max, step = 1, onInput, show, disabled = false }: {
  label: string; value: number; min: number; max: number; step?: number; onInput: (value: number) => void; show?: string; disabled?: boolean;
}) {
  return (
    <label class="slider">
      <span>{label}{show !== undefined && <output>{show}</output>}</span>
      {/* The label around both names the first of them, the output. */}
      <input type="range" aria-label={label} min={min} max={max} step={step} value={value} aria-valuetext={show} disabled={disabled}
        onInput={(event) => onInput(event.currentTarget.valueAsNumber)} />
    </label>
  );
}

/** Dialog that takes the keyboard while it is open. */
export function Dialog({ title, onClose, children }: { title: string; onClose?: () => void; children: ComponentChildren }) {
  const [element, setElement] = useState<HTMLDialogElement | null>(null);
  useEffect(() => { if (element && !element.open) element.showModal(); }, [element]);
  return (
    <dialog ref={setElement} aria-label={title} onCancel={(event) => { event.preventDefault(); onClose?.(); }}>
      <h2>{title}</h2>
      {children}
    </dialog>
  );
}

/** Value of a promise, read anew when a key changes, and what failed while the server was away when it is back. */
export function useLoaded<T>(load: () => Promise<T>, keys: unknown[]): { value: T | null; error: string; reload: () => void } {
  const [state, setState] = useState<{ value: T | null; error: string }>({ value: null, error: "" });
  const [turn, setTurn] = useState(0);
  const isLost = stream.connection.value === "lost";
  useEffect(() => { if (!isLost && state.error) setTurn((value) => value + 1); }, [isLost]);
  useEffect(() => {
    let isCurrent = true;
    load().then(
      (value) => isCurrent && setState({ value, error: "" }),
      (error: Error) => isCurrent && setState((old) => ({ ...old, error: error.message })),
    );
    return () => { isCurrent = false; };
  }, [...keys, turn]);
  return { ...state, reload: () => setTurn((value) => value + 1) };
}

const RETRY_MS = 2000;
const RELOADED = "vantage-reloaded";
const RELOAD_APART_MS = 60_000;

/** Reads the page anew where its parts have other names since an upgrade; not again and again. */
function reloadOnce(): boolean {
  const last = Number(sessionStorage.getItem(RELOADED) ?? 0);
  if (Date.now() - last < RELOAD_APART_MS) return false;
  sessionStorage.setItem(RELOADED, String(Date.now()));
  location.reload();
  return true;
}

/** True once the server answers; false if `isWanted` ends before. */
async function answers(isWanted: () => boolean): Promise<boolean> {
  while (isWanted()) {
    await new Promise((wait) => { setTimeout(wait, RETRY_MS); });
    if (await fetch(document.baseURI, { cache: "no-store" }).then((page) => page.ok, () => false)) return isWanted();
  }
  return false;
}

/** A view that is loaded when it is first needed, and again when the server is back. */
export function Lazy<P>({ load, props }: { load: () => Promise<(props: P) => unknown>; props: P }) {
  const [View, setView] = useState<{ view: (props: P) => never } | null>(null);
  const [error, setError] = useState("");
  useEffect(() => {
    let isWanted = true;
    const attempt = (again: () => void): Promise<void> => load().then((view) => { if (isWanted) { setError(""); setView({ view: view as never }); } }, again);
    void attempt(() => {
      setError(text.viewWaits);
      void answers(() => isWanted).then(async (isUp) => { if (isUp) await attempt(() => { if (!reloadOnce()) setError(text.viewGone); }); });
    });
    return () => { isWanted = false; };
  }, []);
  if (error) return <p class="problem" role="alert">{error} {error === text.viewGone && <Button onClick={() => location.reload()}>{text.reload}</Button>}</p>;
  if (!View) return <p class="soft" role="status">{text.loading}</p>;
  const Loaded = View.view as unknown as (props: P) => never;
  return <Loaded {...(props as P & object)} />;
}

export const Swatch = ({ colour }: { colour: string }) => <span class="swatch" style={{ background: colour }} />;

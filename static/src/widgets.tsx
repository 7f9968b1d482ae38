// Small parts of which the views are made.
import { effect, signal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { useEffect, useLayoutEffect, useRef, useState } from "preact/hooks";
import { askPages, type Page } from "./api";
import { retries, stream, tryAgain } from "./jobs";
import { goTo, hrefOf, visits } from "./settings";
import { text } from "./text";

/** What went wrong last, said once at the top, until the reader goes elsewhere or what failed works again. */
export const message = signal("");
/** Address of what was made while the reader was elsewhere. */
export const made = signal("");
effect(() => { if (visits.value) [message.value, made.value] = ["", ""]; });
effect(() => { if (stream.connection.value === "live" && message.peek().includes(text.noAnswer)) message.value = ""; });

export async function guarded<T>(work: () => Promise<T>): Promise<T | undefined> {
  message.value = "";
  try {
    return await work();
  } catch (error) {
    message.value = (error as Error).message || text.failed;
    return undefined;
  }
}

/** Goes to what is made, whose address `work` answers; a reader who is elsewhere by then gets a link instead. */
export async function goToMade(work: () => Promise<string>): Promise<void> {
  const from = visits.peek();
  const hash = await work();
  if (visits.peek() === from) goTo(hash);
  else made.value = hash;
}

/** Button; one that is `idle` does nothing for now, and keeps the keyboard that one that is disabled loses. */
export function Button({ onClick, children, kind = "", idle = false, ...rest }: {
  onClick: () => unknown; children: ComponentChildren; kind?: string; idle?: boolean; disabled?: boolean; title?: string; "aria-pressed"?: boolean;
  "aria-label"?: string; class?: string;
}) {
  const [busy, setBusy] = useState(false);
  // A second click may come before the first one is drawn.
  const isBusy = useRef(false);
  const click = (): void => {
    if (isBusy.current || idle) return;
    const result = onClick();
    if (!(result instanceof Promise)) return;
    const set = (now: boolean): void => { isBusy.current = now; setBusy(now); };
    set(true);
    void guarded(() => result).finally(() => set(false));
  };
  return <button type="button" {...rest} class={`${kind} ${rest.class ?? ""}`} aria-disabled={busy || idle || undefined} onClick={click}>{children}</button>;
}

/** Answers a function to call before what has the keyboard goes: once it is gone, the keyboard moves to the row after it, the one before
 * it, or the heading. */
function useHandover(): () => void {
  const from = useRef<Element | null | undefined>(undefined);
  useLayoutEffect(() => () => {
    if (from.current === undefined) return;
    const rows = [from.current?.nextElementSibling, from.current?.previousElementSibling];
    setTimeout(() => {
      if (document.activeElement !== document.body) return;
      const row = rows.find((one) => one?.isConnected);
      const next = row?.querySelector<HTMLElement>("a[href]:not([tabindex]), button") ?? document.querySelector<HTMLElement>("#main h1") ?? document.getElementById("main");
      if (next && next.tabIndex < 0) next.tabIndex = -1;
      next?.focus();
    });
  }, []);
  return () => { from.current = document.activeElement?.closest("tr, li") ?? null; };
}

/** Button of what cannot be taken back, which is done once the reader confirms it. */
export function ConfirmButton({ label, sure, onConfirm, ...rest }: {
  label: string; sure: string; onConfirm: () => Promise<unknown>; kind?: string; disabled?: boolean; "aria-label"?: string;
}) {
  const [isOpen, setOpen] = useState(false);
  const close = (): void => setOpen(false);
  const handOver = useHandover();
  const confirm = (): Promise<void> => {
    handOver();
    return onConfirm().then(close);
  };
  return (
    <>
      <Button {...rest} onClick={() => setOpen(true)}>{label}</Button>
      {isOpen && (
        <Dialog title={label} onClose={close}>
          <p>{sure}</p>
          <p class="actions"><Button kind="danger" onClick={confirm}>{label}</Button><Button onClick={close}>{text.jobs.cancel}</Button></p>
        </Dialog>
      )}
    </>
  );
}

/** Field of a number, which is not written anew while one types in it. `onNumber` is told `undefined` where it is empty, and nothing
 * while what stands there is no number. */
export function NumberInput({ value, onNumber, ...rest }: {
  value: number | undefined; onNumber: (value: number | undefined) => void; name?: string; min?: number | undefined; max?: number | undefined; step?: number;
  placeholder?: string; "aria-label"?: string;
}) {
  const field = useRef<HTMLInputElement>(null);
  // A field that is removed loses the focus too.
  const show = (): void => { if (field.current) field.current.value = value === undefined ? "" : String(value); };
  useLayoutEffect(() => { if (document.activeElement !== field.current) show(); }, [value]);
  return (
    <input type="number" step="any" {...rest} ref={field} onBlur={show} onInput={({ currentTarget: { validity, value: given, valueAsNumber } }) => {
      if (!validity.badInput) onNumber(given === "" ? undefined : valueAsNumber);
    }} />
  );
}

/** Button that copies the address of the page; where the browser does not let the page do so, as over plain HTTP, it shows the address. */
export function CopyLink() {
  const [state, setState] = useState("");
  const close = (): void => setState("");
  const copy = (): Promise<void> => (navigator.clipboard?.writeText(location.href) ?? Promise.reject()).then(() => setState("copied"), () => setState("shown"));
  return (
    <>
      <Button onClick={copy}>{state === "copied" ? text.job.copied : text.job.share}</Button>
      {state === "shown" && (
        <Dialog title={text.job.share} onClose={close}>
          <input type="text" class="wide" readOnly aria-label={text.job.share} value={location.href} onFocus={(event) => event.currentTarget.select()} />
          <p class="actions"><Button onClick={close}>{text.close}</Button></p>
        </Dialog>
      )}
    </>
  );
}

/** Says what could not be read, and offers to read it once more; but for an address at which nothing is. */
export function Problem({ error }: { error: string }) {
  const handOver = useHandover();
  return <p class="problem" role="alert">{error} {error !== text.notFound && <Button onClick={() => { handOver(); tryAgain(); }}>{text.retry}</Button>}</p>;
}

/** Stands in place of a view that cannot be shown, or not yet. */
export const Pending = ({ error }: { error?: string | undefined }) => (error
  ? <div class="empty"><Problem error={error} /><a href={hrefOf(["jobs"])}>{text.nav.jobs}</a></div>
  : <p class="soft pending" role="status">{text.loading}</p>);

/** Says that a list is not whole, and reads on. */
export const Cut = ({ page: { items, next_page_token: token }, onMore }: { page: Page<unknown>; onMore: () => void }) => (token
  ? <p class="cut actions"><span class="soft">{text.cut(items.length)}</span> <Button onClick={onMore}>{text.older}</Button></p> : null);

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

/** Dialog that takes the keyboard while it is open and gives it back; what goes wrong is said in it, since it hides the page. */
export function Dialog({ title, onClose, children }: { title: string; onClose?: () => void; children: ComponentChildren }) {
  const [element, setElement] = useState<HTMLDialogElement | null>(null);
  useEffect(() => {
    if (!element) return undefined;
    const before = document.activeElement as HTMLElement | null;
    message.value = "";
    element.showModal();
    return () => before?.focus();
  }, [element]);
  return (
    <dialog ref={setElement} aria-label={title} onCancel={(event) => { event.preventDefault(); onClose?.(); }}>
      <h2>{title}</h2>
      {message.value && <p class="problem" role="alert">{message.value}</p>}
      {children}
    </dialog>
  );
}

/** Value of a promise, read anew when a key changes; what failed, when the server is back or the reader asks for it. `told` is another
 * one with each answer. */
export function useLoaded<T>(load: () => Promise<T>, keys: unknown[]): { value: T | null; error: string; told: unknown; reload: () => void } {
  const [state, setState] = useState<{ value: T | null; error: string }>({ value: null, error: "" });
  const [turn, setTurn] = useState(0);
  const isLost = stream.connection.value === "lost";
  useEffect(() => {
    if (!state.error) return;
    setState((old) => ({ ...old, error: "" }));
    setTurn((value) => value + 1);
  }, [isLost, retries.value]);
  useEffect(() => {
    let isCurrent = true;
    load().then(
      (value) => isCurrent && setState({ value, error: "" }),
      (error: Error) => isCurrent && setState((old) => ({ ...old, error: error.message })),
    );
    return () => { isCurrent = false; };
  }, [...keys, turn]);
  return { ...state, told: state, reload: () => setTurn((value) => value + 1) };
}

const PAGE_SIZE = 100;

/** The newest entries of a list, and with `more` as many older ones again. */
export function useNewest<T>(path: string): { value: Page<T> | null; error: string; told: unknown; reload: () => void; more: () => void } {
  const [wanted, setWanted] = useState(PAGE_SIZE);
  return { ...useLoaded(() => askPages<T>(path, wanted), [path, wanted]), more: () => setWanted(wanted + PAGE_SIZE) };
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
  if (!View) return <Pending />;
  const Loaded = View.view as unknown as (props: P) => never;
  return <Loaded {...(props as P & object)} />;
}

export const Swatch = ({ colour }: { colour: string }) => <span class="swatch" style={{ background: colour }} />;

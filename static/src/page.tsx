// The page: its frame, and the view that its address names.
import { effect } from "@preact/signals";
import { render } from "preact";
import { useEffect, useRef } from "preact/hooks";
import { isSignedIn, keyRequest, signOut } from "./api";
import { applyEvent, jobIds, jobSignal, keepJob, meshProblem, partName, seen, stream, tryAgain } from "./jobs";
import { JobList } from "./joblist";
import { JobView } from "./job";
import { hrefOf, place, theme, unit, type Theme, type Unit } from "./settings";
import { text } from "./text";
import { Dialog, Lazy, made, message, Pending } from "./widgets";

function Nav() {
  const [first = "jobs"] = place.value.path;
  const entry = (path: string, name: string) => (
    <a href={hrefOf([path])} aria-current={first === path || (path === "jobs" && first === "compare") ? "page" : undefined}>{name}</a>
  );
  return (
    <nav aria-label={text.nav.label}>
      {entry("jobs", text.nav.jobs)}{entry("new", text.nav.create)}{entry("runs", text.nav.runs)}{entry("inspections", text.nav.inspections)}{entry("specs", text.nav.specs)}{entry("calibrations", text.nav.calibrations)}
    </nav>
  );
}

function More() {
  const menu = useRef<HTMLDetailsElement>(null);
  useEffect(() => {
    const close = (event: Event): void => {
      const isEscape = (event as KeyboardEvent).key === "Escape";
      if (menu.current?.open && (isEscape || (event.type === "click" && !menu.current.contains(event.target as Node)))) {
        menu.current.open = false;
        if (isEscape) menu.current.querySelector("summary")?.focus();
      }
    };
    addEventListener("click", close);
    addEventListener("keydown", close);
    return () => { removeEventListener("click", close); removeEventListener("keydown", close); };
  }, []);
  return (
    <details class="more" ref={menu}>
      <summary>{text.nav.more}</summary>
      <div class="menu">
        <label><span>{text.settings.theme}</span>
          <select value={theme.value} onChange={(event) => { theme.value = event.currentTarget.value as Theme; }}>
            <option value="auto">{text.settings.auto}</option><option value="light">{text.settings.light}</option>
            <option value="dark">{text.settings.dark}</option>
          </select>
        </label>
        <a href="docs/">{text.nav.api}</a><a href="problems">{text.nav.problems}</a><a href="metrics">{text.nav.metrics}</a>
        <a href="licences">{text.nav.licences}</a>
        {isSignedIn.value && <button id="sign-out" type="button" onClick={() => void signOut()}>{text.nav.signOut}</button>}
      </div>
    </details>
  );
}

function Header() {
  const connection = stream.connection.value;
  return (
    <header class="bar">
      <a class="brand" href={hrefOf(["jobs"])}><img src="assets/icon.svg" alt="" width="24" height="24" /> {text.product}</a>
      <Nav />
      <p id="connection" role="status" data-connection={connection}>{text.connection[connection]}</p>
      <label class="quiet"><span>{text.settings.unit}</span>
        <select value={unit.value} onChange={(event) => { unit.value = event.currentTarget.value as Unit; }}>
          <option value="mm">mm</option><option value="inch">inch</option>
        </select>
      </label>
      <More />
    </header>
  );
}

function KeyDialog() {
  const wanted = keyRequest.value;
  if (!wanted) return null;
  const send = (event: SubmitEvent): void => {
    event.preventDefault();
    const field = (event.currentTarget as HTMLFormElement).elements.namedItem("key") as HTMLInputElement;
    wanted.answer(field.value);
    field.value = "";
  };
  return (
    <Dialog title={text.key.title}>
      <form id="key-form" onSubmit={send}>
        <input type="text" name="username" autocomplete="username" value="vantage" hidden />
        <label><span>{text.key.key}</span><input type="password" name="key" required autocomplete="current-password" /></label>
        <p class="soft">{text.key.note}</p>
        <p id="key-problem" class="problem" role="alert">{wanted.problem}</p>
        <button type="submit" class="primary">{text.key.use}</button>
      </form>
    </Dialog>
  );
}

function View() {
  const { path, query } = place.value;
  const [room = "jobs", first, second] = path;
  if (room === "jobs" && first) return <JobView key={first} id={first} tab={second ?? "plan"} />;
  if (room === "jobs") return <JobList />;
  if (room === "new") return <Lazy key={`new${query.get("from") ?? ""}`} load={async () => (await import("./create")).Create} props={{ from: query.get("from"), set: query.get("set"), at: query.get("at") }} />;
  if (room === "compare") return <Lazy key="compare" load={async () => (await import("./compare")).Compare} props={{ first: first ?? "", second: second ?? "" }} />;
  if (room === "runs" && first) return <Lazy key={first} load={async () => (await import("./run")).RunView} props={{ id: first }} />;
  if (room === "runs") return <Lazy key="runs" load={async () => (await import("./run")).RunList} props={{}} />;
  if (room === "inspections" && first) return <Lazy key={first} load={async () => (await import("./inspections")).InspectionView} props={{ id: first }} />;
  if (room === "inspections") return <Lazy key="inspections" load={async () => (await import("./inspections")).InspectionList} props={{}} />;
  if (room === "calibrations" && first) return <Lazy key={first} load={async () => (await import("./calibrations")).CalibrationView} props={{ id: first }} />;
  if (room === "calibrations") return <Lazy key="calibrations" load={async () => (await import("./calibrations")).CalibrationList} props={{}} />;
  if (room === "specs") return <Lazy key="specs" load={async () => (await import("./specs")).Specs} props={{ kind: first ?? "scanners", name: second ?? "" }} />;
  return <Pending error={text.notFound} />;
}

/** Moves the keyboard to the view when the address names another one, as a page load would. */
function useFocusOnChange(room: string): void {
  const last = useRef(room);
  useEffect(() => {
    if (last.current !== room) document.getElementById("main")?.focus({ preventScroll: true });
    last.current = room;
  }, [room]);
}

function App() {
  useFocusOnChange(place.value.path.slice(0, 2).join("/"));
  return (
    <>
      <button type="button" class="skip" onClick={() => document.getElementById("main")?.focus()}>{text.skip}</button>
      <Header />
      {stream.connection.value === "lost" && <p class="banner" role="alert">{text.connection.lostLong}</p>}
      {message.value && (
        <p id="message" class="banner bad" role="alert">{message.value}
          <button type="button" onClick={() => { message.value = ""; }}>{text.close}</button>
        </p>
      )}
      {meshProblem.value && stream.connection.value !== "lost" && (
        <p id="unnamed" class="banner" role="status">{text.unnamed(meshProblem.value)}
          <button type="button" onClick={tryAgain}>{text.retry}</button>
        </p>
      )}
      {made.value && (
        <p class="banner" role="status"><a href={made.value}>{text.made}</a>
          <button type="button" onClick={() => { made.value = ""; }}>{text.close}</button>
        </p>
      )}
      <main id="main" tabIndex={-1} data-room={place.value.path[0] ?? "jobs"}><View /></main>
      <KeyDialog />
    </>
  );
}

// Tabs and the history of the browser tell the views apart.
effect(() => {
  const [room = "jobs", first] = place.value.path;
  void jobIds.value;
  const job = room === "jobs" && first ? jobSignal(first)?.value : undefined;
  const names: Record<string, string> = { ...text.nav, compare: text.jobs.compare, new: text.nav.create };
  document.title = [job ? partName(job) : names[room], text.product].filter(Boolean).join(" · ");
});

// What tests hold the page against: events handled, and through the views what is drawn.
declare global { interface Window { vantage: Record<string, unknown> } }
window.vantage = { seen, stream, applyEvent, keepJob };
render(<App />, document.getElementById("root")!);

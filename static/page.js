// The page: lists jobs as they change, uploads a part and starts a job with the defaults, links results.

// Relative to the page, so that it works below any path.
const api = new URL("api/v1", document.baseURI).pathname;
const byId = (id) => document.getElementById(id);
const jobs = new Map();
const meshNames = new Map();
let nextPage = null;

// The key is exchanged for a session: its cookie, which no script can read, goes with links, the event stream and every
// request. The header says that this page asks; no other site's page can send it.
const asPage = { "X-Vantage-Session": "1" };
const signedIn = "vantage-signed-in";

class Refused extends Error {
  constructor(problem) {
    super([problem.detail || problem.title, ...(problem.errors || []).map((e) => `${e.pointer}: ${e.detail}`)].join("\n"));
    this.code = problem.code;
  }
}

async function answer(path, options) {
  const response = await fetch(api + path, { ...options, headers: { ...asPage, ...options.headers } });
  if (!response.ok) {
    throw new Refused(await response.json().catch(() => ({ title: `${response.status} ${response.statusText}` })));
  }
  return response.status === 204 ? null : response.json();
}

async function ask(path, options = {}) {
  try {
    return await answer(path, options);
  } catch (error) {
    if (!["key_missing", "key_wrong", "session_ended"].includes(error.code)) throw error;
    await signIn();
    return ask(path, options);
  }
}

let signingIn = null;
function signIn() {
  signingIn ??= keyFromUser()
    .then((key) => answer("/session", { method: "POST", headers: { Authorization: `Bearer ${key}` } }))
    .then(() => { localStorage.setItem(signedIn, "1"); showSignOut(); byId("key-problem").textContent = ""; })
    .catch((error) => { byId("key-problem").textContent = error.message; })
    .finally(() => { signingIn = null; });
  return signingIn;
}

function keyFromUser() {
  return new Promise((resolve) => {
    const dialog = byId("key-dialog");
    dialog.addEventListener("close", () => {
      const key = byId("key-form").elements.key.value.trim();
      byId("key-form").reset();
      resolve(key);
    }, { once: true });
    dialog.addEventListener("cancel", (event) => event.preventDefault());
    dialog.showModal();
  });
}

const showSignOut = () => { byId("sign-out").hidden = !localStorage.getItem(signedIn); };

async function signOut() {
  localStorage.removeItem(signedIn);
  // A session that is over already is as good.
  await answer("/session", { method: "DELETE" }).catch(() => null);
  location.reload();
}

const element = (name, attributes, ...children) => {
  const made = Object.assign(document.createElement(name), attributes);
  made.append(...children);
  return made;
};

const results = [
  ["report.html", "Report", "report"], ["plan.json", "Plan", "plan"], ["program.json", "Program", "program"],
  ["program.csv", "Program (CSV)", "program?dialect=csv"], ["viewpoints.csv", "Viewpoints (CSV)", "viewpoints?format=csv"],
  ["coverage.csv", "Coverage (CSV)", "coverage?format=csv"], ["missed.json", "Missed", "missed"],
  ["candidates.json", "Candidates", "candidates"],
  ["regions.csv", "Regions (CSV)", "files/regions.csv"],
  ["timings.json", "Timings", "timings"],
];

function facts(job) {
  const cell = typeof job.cell === "string" ? job.cell : job.cell.name;
  const spent = Object.values(job.timings).reduce((sum, seconds) => sum + seconds, 0);
  return [
    cell === "none" ? "viewpoints alone" : `cell ${cell}`,
    job.part_number && `part number ${job.part_number}`,
    job.serial && `serial ${job.serial}`,
    job.submitted_by && `submitted by ${job.submitted_by}`,
    ...Object.entries(job.labels).map(([name, value]) => `${name}: ${value}`),
    job.state === "queued" && `place ${job.queue_position} in the queue`,
    job.stage && `${job.stage}, ${Math.round(100 * job.fraction)} %`,
    spent > 0 && `${spent.toFixed(1)} s`,
  ].filter(Boolean).join(" · ");
}

function actions(job) {
  const button = (text, work) => element("button", { type: "button", textContent: text, onclick: () => guarded(work) });
  if (job.state === "queued" || job.state === "running") {
    return [button("Cancel", () => ask(`/jobs/${job.id}/cancel`, { method: "POST" }))];
  }
  return job.state === "cancelling" ? [] : [button("Delete", () => ask(`/jobs/${job.id}`, { method: "DELETE" }))];
}

// The sentences are the server's own: the command line and the reports have the same.
function summaryOf(job) {
  const summary = job.summary;
  if (!summary) return [];
  const next = summary.action && element("li", { className: "next" }, `Next: ${summary.action.text}`);
  return [
    element("li", { className: "verdict" }, summary.title),
    next,
    ...[summary.verdict_text, summary.views_text, summary.coverage_text, summary.cycle_text].filter(Boolean)
      .map((text) => element("li", {}, text)),
  ].filter(Boolean);
}

const percent = (share) => `${(100 * share).toFixed(2)} %`;

function regionRow(region) {
  const verdict = { true: "met", false: "not met" }[region.met] ?? "–";
  const cell = (text, className = "") => element("td", { textContent: text, className });
  return element("tr", { className: region.met === false ? "unmet" : "" },
    cell(region.name),
    cell(region.tolerance_mm === undefined ? region.kind : `${region.kind}, ${region.tolerance_mm} mm`),
    cell(region.asked_area_mm2 < 10 ? region.asked_area_mm2.toPrecision(3) : region.asked_area_mm2.toFixed(1), "number"), cell(region.samples, "number"),
    cell(region.target === undefined ? "–" : percent(region.target), "number"), cell(percent(region.of_asked), "number"),
    cell(verdict), cell(region.why_unmet ?? ""));
}

function regionTable(regions) {
  const names = ["Region", "Kind", "Area, mm²", "Samples", "Target", "Reached", "Verdict", "Why not"];
  return element("table", {},
    element("caption", {}, "Regions"),
    element("thead", {}, element("tr", {}, ...names.map((name) => element("th", { scope: "col" }, name)))),
    element("tbody", {}, ...regions.map(regionRow)));
}

function draw(job) {
  let item = byId(`job-${job.id}`);
  if (!item) {
    item = byId("job-template").content.firstElementChild.cloneNode(true);
    item.id = `job-${job.id}`;
    // Ids rise with time, and the newest stands first.
    const after = [...byId("jobs").children].find((other) => other.id < item.id);
    byId("jobs").insertBefore(item, after ?? null);
  }
  const old = item.dataset.state;
  item.dataset.state = job.state;
  item.querySelector(".part").textContent = meshNames.get(job.mesh_id) ?? job.mesh_id;
  item.querySelector(".state").textContent = job.state;
  const time = item.querySelector("time");
  time.dateTime = job.created_at;
  time.textContent = new Date(job.created_at).toLocaleString();
  item.querySelector(".facts").textContent = facts(job);
  item.dataset.level = job.summary?.level ?? "";
  item.querySelector(".summary").replaceChildren(...summaryOf(job));
  const progress = item.querySelector("progress");
  progress.hidden = !["running", "cancelling"].includes(job.state);
  progress.value = job.fraction;
  progress.setAttribute("aria-label", `Progress of ${item.querySelector(".part").textContent}`);
  item.querySelector(".problem").textContent = job.problem
    ? [`${job.problem.title}: ${job.problem.detail}`, ...job.problem.errors.map((e) => `${e.pointer}: ${e.detail}`)].join("\n") : "";
  item.querySelector(".warnings").textContent = (job.warnings ?? [])
    .map((warning) => `${warning.pointer}: ${warning.detail}\n→ ${warning.remedy}`).join("\n");
  const names = new Set(job.results.map((file) => file.name));
  item.querySelector(".results").replaceChildren(...results.filter(([name]) => names.has(name))
    .map(([, text, path]) => element("a", { href: `${api}/jobs/${job.id}/${path}`, target: "_blank", rel: "noopener" }, text)));
  item.querySelector(".regions").replaceChildren(...(job.regions?.length ? [regionTable(job.regions)] : []));
  // Buttons are left alone while nothing changes for them, so that focus stays.
  if (old !== job.state) item.querySelector(".actions").replaceChildren(...actions(job));
  byId("empty").hidden = true;
}

async function show(job) {
  jobs.set(job.id, job);
  if (!meshNames.has(job.mesh_id)) {
    meshNames.set(job.mesh_id, await ask(`/meshes/${job.mesh_id}`).then((mesh) => mesh.name, () => null) ?? job.mesh_id);
  }
  draw(jobs.get(job.id) ?? job);
  if (!job.regions && hasRegions(job)) regionsOf(job.id);
}

// Lists have everything but the regions, which few jobs have.
const hasRegions = (job) => job.results.some((file) => file.name === "regions.csv");
async function regionsOf(id) {
  const whole = await ask(`/jobs/${id}?fields=regions,warnings`).catch(() => null);
  const job = jobs.get(id);
  if (!whole || !job) return;
  Object.assign(job, { regions: whole.regions, warnings: whole.warnings });
  draw(job);
}

// A place became free: everybody behind moves up, which one list tells.
async function movedUp() {
  if (![...jobs.values()].some((job) => job.state === "queued")) return;
  const page = await ask("/jobs?state=queued&fields=queue_position&page_size=1000").catch(() => ({ items: [] }));
  for (const { id, queue_position } of page.items) {
    const job = jobs.get(id);
    if (job?.state !== "queued") continue;
    Object.assign(job, { queue_position });
    draw(job);
  }
}

async function list(token) {
  const page = await ask(`/jobs?page_size=25${token ? `&page_token=${encodeURIComponent(token)}` : ""}`);
  for (const job of page.items) await show(job);
  nextPage = page.next_page_token ?? null;
  byId("more").hidden = !nextPage;
  byId("empty").hidden = jobs.size > 0;
}

// One request a job at a time, and one more when something happened meanwhile.
const reading = new Map();
async function refresh(id) {
  if (reading.has(id)) { reading.set(id, true); return; }
  reading.set(id, false);
  try {
    await show(await ask(`/jobs/${id}`));
  } catch (error) {
    if (error.code === "job_not_found") forget(id);
  }
  const again = reading.get(id);
  reading.delete(id);
  if (again) refresh(id);
}

function forget(id) {
  jobs.delete(id);
  byId(`job-${id}`)?.remove();
  byId("empty").hidden = jobs.size > 0;
}

function follow() {
  const source = new EventSource(`${api}/events`);
  source.onopen = () => { byId("connection").textContent = "live"; };
  source.onerror = () => {
    byId("connection").textContent = "not connected; trying again …";
    // After an answer that is no stream, the browser does not come back by itself.
    if (source.readyState === EventSource.CLOSED) setTimeout(() => list().then(follow, follow), 3000);
  };
  const changed = (event) => {
    const about = JSON.parse(event.data);
    const job = jobs.get(about.job_id);
    if (event.type === "progress" && job) {
      Object.assign(job, { stage: about.stage, fraction: about.fraction, state: about.state });
      draw(job);
    } else {
      refresh(about.job_id);
      movedUp();
    }
  };
  for (const kind of ["queued", "started", "progress", "cancelling", "succeeded", "failed", "cancelled"]) {
    source.addEventListener(kind, changed);
  }
  source.addEventListener("deleted", (event) => forget(JSON.parse(event.data).job_id));
  source.addEventListener("reset", () => guarded(() => list()));
}

async function guarded(work) {
  byId("message").textContent = "";
  try {
    return await work();
  } catch (error) {
    byId("message").textContent = error.message;
  }
}

async function start(event) {
  event.preventDefault();
  const form = event.target;
  const fields = form.elements;
  const button = form.querySelector("button");
  button.disabled = true;
  await guarded(async () => {
    const file = fields.file.files[0];
    const query = new URLSearchParams({ unit: fields.unit.value, name: file.name.slice(0, 200) });
    const mesh = await ask(`/meshes?${query}`, { method: "POST", body: file });
    meshNames.set(mesh.id, mesh.name ?? mesh.id);
    const request = { mesh_id: mesh.id, cell: fields.cell.value };
    if (request.cell === "none") request.scanner = fields.scanner.value;
    if (fields.part_number.value) request.part_number = fields.part_number.value;
    const headers = { "Content-Type": "application/json", "Idempotency-Key": crypto.getRandomValues(new Uint32Array(4)).join("-") };
    await show(await ask("/jobs", { method: "POST", headers, body: JSON.stringify(request) }));
    form.reset();
    chooseCell();
  });
  button.disabled = false;
}

const chooseCell = () => { byId("scanner-field").hidden = byId("start").elements.cell.value !== "none"; };

async function choices() {
  const fields = byId("start").elements;
  const [cells, scanners] = await Promise.all([ask("/cells"), ask("/scanners")]);
  const option = (item, chosen) => element("option", { value: item.name, defaultSelected: item.name === chosen }, item.name);
  fields.cell.prepend(...cells.items.map((item) => option(item, "e05-transcan")));
  fields.scanner.append(...scanners.items.map((item) => option(item, "transcan-c")));
  chooseCell();
}

byId("start").addEventListener("submit", start);
byId("start").elements.cell.addEventListener("change", chooseCell);
byId("sign-out").addEventListener("click", signOut);
showSignOut();
byId("more").addEventListener("click", () => guarded(() => list(nextPage)));
await guarded(choices);
await guarded(() => list());
follow();

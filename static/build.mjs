// Builds `dist/`, the folder that the program embeds, from `src/`: the same sources and the same lock give the same bytes.
// `--out DIR` builds elsewhere, for the check that what is committed is what the sources give. Writes `BYTES.md`, a table of
// what is bundled, and fails if everything together exceeds the limit that a plant's slow link can bear.
import { cpSync, mkdirSync, readFileSync, readdirSync, rmSync, writeFileSync } from "node:fs";
import { basename, dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { gzipSync } from "node:zlib";
import { build } from "esbuild";

const root = dirname(fileURLToPath(import.meta.url));
const at = process.argv.indexOf("--out");
const out = at > 0 ? process.argv[at + 1] : join(root, "dist");
const LIMIT_KB = 300;

// Shaders of materials that the page does not use: physical, Phong, toon, matcap and normal ones, shadows, environment maps; and of maps,
// hashed transparency and light probes, which its materials do not have.
const UNUSED_CHUNKS = ["lights_physical_pars_fragment", "lights_physical_fragment", "lights_phong_pars_fragment", "lights_toon_pars_fragment",
  "transmission_pars_fragment", "transmission_fragment", "iridescence_fragment", "envmap_physical_pars_fragment", "shadowmap_pars_fragment",
  "shadowmap_vertex", "shadowmap_pars_vertex", "shadowmask_pars_fragment", "gradientmap_pars_fragment", "bumpmap_pars_fragment", "normalmap_pars_fragment",
  "alphahash_pars_fragment", "lightprobes_pars_fragment"];
const UNUSED_SHADERS = ["DISTANCE", "MATCAP", "NORMAL", "PHONG", "STANDARD", "TOON"];

/** three.js with empty texts in place of the shaders that are not used; each must be there to be left out. */
function withoutUnusedShaders(source) {
  const empty = (text, pattern, name) => {
    if (!pattern.test(text)) throw new Error(`three.js has no shader ${name}`);
    return text.replace(pattern, '$1"";');
  };
  const rest = UNUSED_CHUNKS.reduce((text, name) => empty(text, new RegExp(`^((?:const|var) ${name} = )".*";$`, "m"), name), source);
  return UNUSED_SHADERS.reduce((text, name) => empty(text, new RegExp(`^(const (?:vertex|fragment)\\$\\w+ = )"#define ${name}\\\\n.*";$`, "gm"), name), rest);
}

const shaders = {
  name: "shaders",
  setup: ({ onLoad }) => onLoad({ filter: /three[\\/]build[\\/]three\.module\.js$/ },
    ({ path }) => ({ contents: withoutUnusedShaders(readFileSync(path, "utf8")), loader: "js" })),
};

rmSync(out, { recursive: true, force: true });
mkdirSync(out, { recursive: true });
const { metafile } = await build({
  absWorkingDir: root,
  entryPoints: ["src/page.tsx", "src/worker.ts", "src/beat.ts", "src/style.css"],
  outdir: out,
  bundle: true,
  splitting: true,
  format: "esm",
  minify: true,
  metafile: true,
  target: "es2022",
  charset: "utf8",
  // The folder of packages may be linked; what it is called then is not to change a byte.
  preserveSymlinks: true,
  jsx: "automatic",
  jsxImportSource: "preact",
  chunkNames: "[name]-[hash]",
  legalComments: "none",
  plugins: [shaders],
  logLevel: "warning",
});
cpSync(join(root, "src/icon.svg"), join(out, "icon.svg"));

// What the page begins with is asked for together with it, not only once the page was read.
const page = Object.values(metafile.outputs).find((output) => output.entryPoint === "src/page.tsx");
const parts = page.imports.filter(({ kind }) => kind === "import-statement").map(({ path }) => basename(path)).sort();
const links = parts.map((name) => `  <link rel="modulepreload" href="assets/${name}">\n`).join("");
writeFileSync(join(out, "index.html"), readFileSync(join(root, "src/index.html"), "utf8").replace("</head>", `${links}</head>`));

/** Package of an input path, `vantage` for our own sources. */
function owner(path) {
  const parts = path.split("node_modules/").at(-1).split("/");
  return !path.includes("node_modules/") ? "vantage" : parts[0].startsWith("@") ? parts.slice(0, 2).join("/") : parts[0];
}

const inBundle = new Map();
for (const output of Object.values(metafile.outputs)) {
  for (const [path, { bytesInOutput }] of Object.entries(output.inputs)) {
    inBundle.set(owner(path), (inBundle.get(owner(path)) ?? 0) + bytesInOutput);
  }
}
const packages = [...inBundle.keys()].filter((name) => name !== "vantage").sort();

/** Name, version, licence and text of the licence of a bundled package. */
function licenceOf(name) {
  const folder = join(root, "node_modules", name);
  const { version, license } = JSON.parse(readFileSync(join(folder, "package.json"), "utf8"));
  const file = readdirSync(folder).find((file) => /^licen[cs]e/i.test(file));
  return { name, version, license, text: file ? readFileSync(join(folder, file), "utf8").trim() : `Licence: ${license}` };
}

const licences = packages.map(licenceOf);
const rule = "-".repeat(72);
writeFileSync(join(out, "licences.txt"), [
  "Third-party software in the dashboard",
  "",
  ...licences.map(({ name, version, license }) => `${name} ${version}: ${license}`),
  ...licences.flatMap(({ name, version, text }) => ["", rule, `${name} ${version}`, rule, "", text]),
  "",
].join("\n"));

const kb = (bytes) => (bytes / 1024).toFixed(1);
const rows = readdirSync(out).sort().map((name) => {
  const bytes = readFileSync(join(out, name));
  return { name: name.replace(/-[A-Z0-9]{8}\./, "-*."), raw: bytes.length, gzip: gzipSync(bytes, { level: 9 }).length };
});
const total = rows.reduce((sum, { raw, gzip }) => ({ raw: sum.raw + raw, gzip: sum.gzip + gzip }), { raw: 0, gzip: 0 });
const table = [
  "# Bytes of the dashboard",
  "",
  `Made by \`npm run build\`, which fails above ${LIMIT_KB} KB gzip in all.`,
  "",
  "| file | KB | KB gzip |", "| --- | --: | --: |",
  ...[...rows, { name: "**all**", ...total }].map(({ name, raw, gzip }) => `| ${name} | ${kb(raw)} | ${kb(gzip)} |`),
  "",
  "| part | version | licence | KB minified |", "| --- | --- | --- | --: |",
  ...licences.map(({ name, version, license }) => `| ${name} | ${version} | ${license} | ${kb(inBundle.get(name))} |`),
  `| vantage |  |  | ${kb(inBundle.get("vantage"))} |`,
  "",
].join("\n");
if (at < 0) writeFileSync(join(root, "BYTES.md"), table);
console.log(table);
if (total.gzip > LIMIT_KB * 1024) {
  console.error(`the dashboard has ${kb(total.gzip)} KB gzip; the limit is ${LIMIT_KB} KB`);
  process.exit(1);
}

// Forms made from the server's own schema: ranges, defaults and help are those of the API document.
import { signal } from "@preact/signals";
import { useEffect, useRef, useState } from "preact/hooks";
import { ask } from "./api";
import { text } from "./text";

export interface Schema {
  $ref?: string; type?: string | string[]; enum?: (string | number)[]; properties?: Record<string, Schema>; required?: string[];
  oneOf?: Schema[]; anyOf?: Schema[]; allOf?: Schema[]; items?: Schema; minimum?: number; maximum?: number; default?: unknown;
  description?: string; minItems?: number; maxItems?: number; maxLength?: number;
}
export interface Api { components: { schemas: Record<string, Schema> } }

let asked: Promise<Api> | null = null;
export const apiDocument = (): Promise<Api> => (asked ??= ask<Api>("/openapi.json").catch((error: unknown) => {
  // Asked again by the next reader of it.
  asked = null;
  throw error;
}));

/** Follows references; a choice between something and null is that something. */
export function resolved(api: Api, schema: Schema): Schema {
  if (schema.$ref) {
    const { $ref, ...own } = schema;
    return { ...resolved(api, api.components.schemas[$ref.split("/").at(-1)!] ?? {}), ...own };
  }
  const choices = (schema.oneOf ?? schema.anyOf)?.filter((choice) => choice.type !== "null");
  if (choices?.length === 1) return { ...resolved(api, choices[0]!), ...withoutChoices(schema) };
  if (schema.allOf) {
    const all = schema.allOf.map((part) => resolved(api, part));
    return { ...all.reduce((sum, part) => ({ ...sum, ...part, properties: { ...sum.properties, ...part.properties } }), {}), ...withoutChoices(schema) };
  }
  return schema;
}

function withoutChoices({ oneOf: _one, anyOf: _any, allOf: _all, ...rest }: Schema): Schema {
  return rest;
}

const typeOf = (schema: Schema): string => [schema.type].flat().filter((type) => type && type !== "null")[0] ?? "any";

interface FieldProps { api: Api; schema: Schema; name: string; value: unknown; onChange: (value: unknown) => void; fallback?: unknown }

/** A description of the API as plain text: without backticks and line breaks. */
const prose = (words = ""): string => words.replaceAll("`", "").replaceAll("\n", " ");

/** Range of a number; empty where it has none. */
const rangeOf = ({ minimum: from, maximum: to }: Schema): string =>
  (from !== undefined && to !== undefined ? `${from} to ${to}` : from !== undefined ? `≥ ${from}` : to !== undefined ? `≤ ${to}` : "");

/** Range, default and unit, which descriptions end with. */
function hint(schema: Schema, fallback: unknown): string {
  const range = rangeOf(schema);
  const standard = fallback === undefined || fallback === null ? "" : `${text.create.default} ${JSON.stringify(fallback)}`;
  return [range, standard].filter(Boolean).join(" · ");
}

/** Fields of the form that is shown whose text is not valid JSON: with them, nothing is sent. */
const unread = signal<{ name: string }[]>([]);

/** Counts a field among those as long as it is shown and cannot be read. */
export function useUnread(name: string, isUnread: boolean): void {
  useEffect(() => {
    if (!isUnread) return undefined;
    const mine = { name };
    unread.value = [...unread.peek(), mine];
    return () => { unread.value = unread.peek().filter((other) => other !== mine); };
  }, [isUnread]);
}

/** Returns what is to be corrected first; nothing where the whole form can be read. */
export const toCorrect = (): string => (unread.value[0] ? text.create.correct(unread.value[0].name) : "");

function JsonField({ value, onChange, label, rows = 2 }: { value: unknown; onChange: (value: unknown) => void; label: string; rows?: number }) {
  const [draft, setDraft] = useState(() => (value === undefined ? "" : JSON.stringify(value)));
  const [problem, setProblem] = useState("");
  const field = useRef<HTMLTextAreaElement>(null);
  useUnread(label, problem !== "");
  useEffect(() => { if (value === undefined && document.activeElement !== field.current) { setDraft(""); setProblem(""); } }, [value]);
  const take = (given: string): void => {
    setDraft(given);
    try {
      onChange(given.trim() === "" ? undefined : JSON.parse(given));
      setProblem("");
    } catch {
      setProblem(text.create.invalid);
    }
  };
  return (
    <>
      <textarea ref={field} aria-label={label} aria-invalid={problem !== ""} rows={rows} spellcheck={false} value={draft} onInput={(event) => take(event.currentTarget.value)} />
      {problem && <span class="problem" role="alert">{problem}</span>}
    </>
  );
}

const NUMBER = /^[-−+]?(\d+\.?\d*|\.\d+)(e[-−+]?\d+)?$/i;
const numberOf = (given: string): number => Number(given.replaceAll("−", "-"));

/** What keeps a text from being a number that a schema allows; empty where nothing does. */
function numberFault(given: string, schema: Schema): string {
  const { minimum: from, maximum: to } = schema;
  if (given === "") return "";
  if (given.includes(",")) return text.create.comma;
  if (!NUMBER.test(given)) return text.create.noNumber;
  const value = numberOf(given);
  if (typeOf(schema) === "integer" && !Number.isInteger(value)) return text.create.noInteger;
  return value < (from ?? -Infinity) || value > (to ?? Infinity) ? text.create.allowed(rangeOf(schema)) : "";
}

/** Field of a number, as text: fields that browsers have for numbers drop a decimal comma without a word. What is no number or out of its
 *  range is marked, and not told. */
function NumberField({ schema, value, onChange, label, fallback }: {
  schema: Schema; value: unknown; onChange: (value: number | undefined) => void; label: string; fallback?: unknown;
}) {
  // As typed, until the field is left with a number in it.
  const [draft, setDraft] = useState<string | null>(null);
  const field = useRef<HTMLInputElement>(null);
  // Of "0,95", the "0" was a number on the way: what is no number leaves the value as it was when the field was entered.
  const before = useRef(value);
  const fault = draft === null ? "" : numberFault(draft.trim(), schema);
  useUnread(label, fault !== "");
  useEffect(() => { if (document.activeElement !== field.current) setDraft(null); }, [value]);
  const take = (given: string): void => {
    setDraft(given);
    const typed = given.trim();
    if (numberFault(typed, schema) !== "") onChange(before.current as number | undefined);
    else onChange(typed === "" ? undefined : numberOf(typed));
  };
  return (
    <>
      <input ref={field} type="text" inputMode="decimal" autocomplete="off" aria-label={label} aria-invalid={fault !== ""}
        value={draft ?? (typeof value === "number" ? String(value) : "")} placeholder={fallback === undefined || fallback === null ? "" : String(fallback)}
        onFocus={() => { before.current = value; }} onInput={(event) => take(event.currentTarget.value)} onBlur={() => { if (!fault) setDraft(null); }} />
      {fault && <span class="problem" role="alert">{fault}</span>}
    </>
  );
}

function Numbers({ value, onChange, label, count, items }: { value: unknown; onChange: (value: unknown) => void; label: string; count: number; items: Schema }) {
  const numbers = Array.isArray(value) ? (value as number[]) : Array<number>(count).fill(0);
  return (
    <span class="numbers">
      {numbers.map((number, i) => (
        <NumberField key={i} schema={items} label={`${label} ${i + 1}`} value={number}
          onChange={(given) => { if (given !== undefined) onChange(numbers.map((old, at) => (at === i ? given : old))); }} />
      ))}
    </span>
  );
}

function Checks({ choices, value, onChange, label }: { choices: string[]; value: string[]; onChange: (value: unknown) => void; label: string }) {
  return (
    <span class="checks" role="group" aria-label={label}>
      {choices.map((choice) => (
        <label key={choice}><input type="checkbox" checked={value.includes(choice)} onChange={(event) => onChange(
          event.currentTarget.checked ? [...value, choice] : value.filter((other) => other !== choice))} />{choice}</label>
      ))}
    </span>
  );
}

/** Field of a value that is no object. */
function Control(props: FieldProps) {
  const { api, value, onChange, name, fallback } = props;
  const schema = resolved(api, props.schema);
  const type = typeOf(schema);
  if (schema.enum) {
    return (
      <select aria-label={name} value={value === undefined || value === null ? "" : String(value)}
        onChange={(event) => onChange(event.currentTarget.value === "" ? undefined : event.currentTarget.value)}>
        <option value="">{fallback === undefined || fallback === null ? text.none : `${String(fallback)} (${text.create.default})`}</option>
        {schema.enum.map((choice) => <option key={choice} value={String(choice)}>{choice}</option>)}
      </select>
    );
  }
  if (type === "boolean") {
    return <input type="checkbox" aria-label={name} checked={Boolean(value ?? fallback)} onChange={(event) => onChange(event.currentTarget.checked)} />;
  }
  if (type === "number" || type === "integer") return <NumberField schema={schema} value={value} onChange={onChange} label={name} fallback={fallback} />;
  if (type === "string") {
    return <input type="text" aria-label={name} maxLength={schema.maxLength} value={typeof value === "string" ? value : ""}
      onInput={(event) => onChange(event.currentTarget.value === "" ? undefined : event.currentTarget.value)} />;
  }
  const items = schema.items && resolved(api, schema.items);
  if (type === "array" && items?.enum) {
    return <Checks choices={items.enum.map(String)} value={(value ?? fallback ?? []) as string[]} onChange={onChange} label={name} />;
  }
  const isFixed = schema.minItems !== undefined && schema.minItems === schema.maxItems && schema.minItems <= 7;
  if (type === "array" && isFixed && ["number", "integer"].includes(typeOf(items ?? {}))) {
    return <Numbers value={value} onChange={onChange} label={name} count={schema.minItems!} items={items!} />;
  }
  return <JsonField value={value} onChange={onChange} label={name} />;
}

/** Alternatives of a schema. */
const choicesOf = (api: Api, schema: Schema): Schema[] =>
  (schema.oneOf ?? schema.anyOf ?? []).map((choice) => resolved(api, choice)).filter((choice) => typeOf(choice) !== "null");
const kindOf = (choice: Schema): string | undefined => choice.properties?.kind?.enum?.[0]?.toString();

/** The alternative that a value is written in; the first for what is not written yet. */
function chosen(api: Api, schema: Schema, value: unknown): Schema | undefined {
  const choices = choicesOf(api, schema);
  if (typeof value === "string") return choices.find((choice) => typeOf(choice) === "string" || choice.enum);
  if (typeof value !== "object" || value === null || Array.isArray(value)) return undefined;
  const { kind } = value as { kind?: string };
  if (kind !== undefined) return choices.find((choice) => kindOf(choice) === kind);
  return choices.find((choice) => choice.properties && Object.keys(value).every((key) => key in choice.properties!));
}

/** Choice among shapes that a kind tells apart. */
function Kinds({ choices, kind, name, onChange }: { choices: Schema[]; kind: string | undefined; name: string; onChange: (value: unknown) => void }) {
  return (
    <label class="kinds"><span>{name}.kind</span>
      <select value={kind ?? ""} onChange={(event) => onChange({ kind: event.currentTarget.value })}>
        {kind === undefined && <option value="">{text.none}</option>}
        {choices.map((choice) => <option key={kindOf(choice)} value={kindOf(choice)}>{kindOf(choice)}</option>)}
      </select>
    </label>
  );
}

/** A list of objects, each of which can be removed, and more added. */
function Items({ api, schema, name, value, onChange }: FieldProps) {
  const items = (value ?? []) as unknown[];
  const set = (at: number, given: unknown): void => {
    const left = given === undefined ? items.filter((_, i) => i !== at) : items.map((old, i) => (i === at ? given : old));
    onChange(left.length > 0 ? left : undefined);
  };
  return (
    <fieldset>
      <legend>{name}</legend>
      {schema.description && <p class="soft">{prose(schema.description)}</p>}
      {items.map((item, i) => (
        <div key={i}>
          <Field api={api} schema={schema.items!} name={`${name} ${i + 1}`} value={item} onChange={(given) => set(i, given ?? {})} />
          <button type="button" class="link" onClick={() => set(i, undefined)}>{text.create.drop1(`${name} ${i + 1}`)}</button>
        </div>
      ))}
      <button type="button" onClick={() => onChange([...items, {}])}>{text.create.add(name)}</button>
    </fieldset>
  );
}

export function Field(props: FieldProps & { isChanged?: boolean; onReset?: () => void }) {
  const whole = resolved(props.api, props.schema);
  if (isPose(props.api, whole)) return <PoseField {...props} />;
  const choices = choicesOf(props.api, whole);
  const kinds = choices.length > 0 && choices.every((choice) => kindOf(choice) !== undefined);
  const found = choices.length > 0 ? chosen(props.api, whole, props.value) : undefined;
  if (kinds && typeof props.value === "object" && props.value !== null) {
    return (
      <div class="of-kind">
        <Kinds choices={choices} kind={found && kindOf(found)} name={props.name} onChange={props.onChange} />
        {found && <ObjectField {...props} fallback={undefined} schema={{ ...found, properties: Object.fromEntries(Object.entries(found.properties!).filter(([key]) => key !== "kind")) }} />}
      </div>
    );
  }
  const schema = found ? { ...found, description: whole.description ?? found.description } as Schema : whole;
  if (found) return <Field {...props} schema={schema} />;
  const item = typeOf(schema) === "array" && schema.items ? resolved(props.api, schema.items) : undefined;
  if (item && (item.properties || choicesOf(props.api, item).some((choice) => choice.properties))) return <Items {...props} schema={schema} />;
  const fallback = props.fallback ?? schema.default;
  if (typeOf(schema) === "object" && schema.properties) return <ObjectField {...props} />;
  return (
    <div class={`field ${props.isChanged ? "changed" : ""}`}>
      <span class="name">{props.name}</span>
      <Control {...props} fallback={fallback} />
      <span class="help">{prose(schema.description)} <em>{hint(schema, fallback)}</em>
        {props.isChanged && props.onReset && <button type="button" class="link" onClick={props.onReset}>{text.create.reset}</button>}
      </span>
    </div>
  );
}

const ROTATIONS = { quaternion_xyzw: [0, 0, 0, 1], rpy_deg: [0, 0, 0] };
type Rotation = keyof typeof ROTATIONS;
const isRotation = (key: string): key is Rotation => key in ROTATIONS;

/** Poses whose rotation can be given as a quaternion or as angles. */
const isPose = (api: Api, schema: Schema): boolean => {
  const choices = choicesOf(api, schema);
  return choices.length === 2 && choices.every(({ properties }) => properties?.translation_mm) && choices.some(({ properties }) => properties?.rpy_deg);
};

interface GivenPose { translation_mm: number[]; quaternion_xyzw?: number[]; rpy_deg?: number[] }

const RAD = Math.PI / 180;

/** The other way to state a rotation: turns about the fixed axes X, Y, Z in this order, R = Rz · Ry · Rx. */
function restated({ quaternion_xyzw: quaternion, rpy_deg: angles }: GivenPose): number[] {
  const tidy = (value: number): number => Number(value.toFixed(9)) + 0;
  if (quaternion) {
    const norm = Math.hypot(...quaternion) || 1;
    const [x, y, z, w] = quaternion.map((value) => value / norm) as [number, number, number, number];
    const up = Math.max(-1, Math.min(1, 2 * (w * y - z * x)));
    // With the nose straight up or down, roll and yaw turn about one axis: all of it is yaw.
    const turns = Math.abs(up) > 1 - 1e-12 ? [0, Math.asin(up), Math.atan2(2 * (w * z - x * y), 1 - 2 * (x * x + z * z))]
      : [Math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)), Math.asin(up), Math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))];
    return turns.map((rad) => tidy(rad / RAD));
  }
  const [[sr, cr], [sp, cp], [sy, cy]] = (angles ?? [0, 0, 0]).map((deg) => [Math.sin((deg * RAD) / 2), Math.cos((deg * RAD) / 2)]) as [number, number][] as
    [[number, number], [number, number], [number, number]];
  return [sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy, cr * cp * cy + sr * sp * sy].map(tidy);
}

function PoseField({ api, schema, name, value, onChange, isChanged, onReset }: FieldProps & { isChanged?: boolean; onReset?: () => void }) {
  const whole = resolved(api, schema);
  const pose = (value ?? null) as GivenPose | null;
  const kind: Rotation = pose && "rpy_deg" in pose ? "rpy_deg" : "quaternion_xyzw";
  const inner = pose && choicesOf(api, whole).find(({ properties }) => properties?.[kind])?.properties;
  return (
    <fieldset class="pose" data-pose={name}>
      <legend>{name}</legend>
      <p class="help soft">{prose(whole.description)} {isChanged && onReset && <button type="button" class="link" onClick={onReset}>{text.create.reset}</button>}</p>
      {!pose && <button type="button" onClick={() => onChange({ translation_mm: [0, 0, 0], quaternion_xyzw: ROTATIONS.quaternion_xyzw })}>{text.create.state(name)}</button>}
      {pose && (
        <>
          <Field api={api} schema={inner!.translation_mm!} name="translation_mm" value={pose.translation_mm} onChange={(given) => onChange({ ...pose, translation_mm: given })} />
          <label class="kinds"><span>{text.create.rotation}</span>
            <select value={kind} onChange={(event) => {
              const next = event.currentTarget.value;
              if (isRotation(next) && next !== kind) onChange({ translation_mm: pose.translation_mm, [next]: restated(pose) });
            }}>{Object.entries(text.create.rotations).map(([key, shown]) => <option key={key} value={key}>{shown}</option>)}</select>
          </label>
          <Field key={kind} api={api} schema={inner![kind]!} name={kind} value={pose[kind] ?? ROTATIONS[kind]} onChange={(given) => onChange({ ...pose, [kind]: given })} />
          {schema.oneOf?.some((choice) => choice.type === "null") && <button type="button" class="link" onClick={() => onChange(undefined)}>{text.create.drop1(name)}</button>}
        </>
      )}
    </fieldset>
  );
}

/** The name first, then poses, what is required, and the rest; the document itself has them by the alphabet. */
function ordered(api: Api, { properties = {}, required = [] }: Schema): [string, Schema][] {
  const rank = ([key, schema]: [string, Schema]): number =>
    key === "name" ? 0 : isPose(api, resolved(api, schema)) ? 1 : required.includes(key) ? 2 : 3;
  return Object.entries(properties).sort((a, b) => rank(a) - rank(b));
}

/** Fields of an object, each of which may be left out; where the object has a default, what is left out is of that. */
export function ObjectField({ api, schema, name, value, onChange, fallback }: FieldProps) {
  const whole = resolved(api, schema);
  const [object, standard] = [(value ?? {}) as Record<string, unknown>, (fallback ?? {}) as Record<string, unknown>];
  const set = (key: string, given: unknown): void => {
    const { [key]: _old, ...rest } = object;
    const made = { ...standard, ...rest, ...(given !== undefined && { [key]: given }) };
    onChange(fallback && isSame(made, fallback) ? undefined : made);
  };
  return (
    <fieldset>
      <legend>{name}</legend>
      {ordered(api, whole).map(([key, inner]) => (
        <Field key={key} api={api} schema={inner} name={key} value={object[key]} fallback={standard[key]} onChange={(given) => set(key, given)} />
      ))}
    </fieldset>
  );
}

const isNested = (api: Api, schema: Schema): boolean => Boolean(resolved(api, schema).properties);

/** Parameters by group; holds only what is changed. */
export function ParamForm({ api, value, onChange, at = null }: {
  /** Field that is shown from the beginning. */
  at?: string | null;
  api: Api; value: Record<string, Record<string, unknown> | unknown>; onChange: (value: Record<string, unknown>) => void;
}) {
  const [words, setWords] = useState("");
  const root = resolved(api, { $ref: "PlanParams" });
  const groups = Object.entries(root.properties ?? {});
  const scalars = groups.filter(([, schema]) => !isNested(api, schema));
  const set = (group: string, key: string | null, given: unknown): void => {
    const next: Record<string, unknown> = { ...value };
    if (key === null) {
      if (given === undefined) delete next[group]; else next[group] = given;
    } else {
      const { [key]: _old, ...rest } = (value[group] ?? {}) as Record<string, unknown>;
      const inner = given === undefined ? rest : { ...rest, [key]: given };
      if (Object.keys(inner).length === 0) delete next[group]; else next[group] = inner;
    }
    onChange(next);
  };
  const has = (group: string, key: string, schema: Schema): boolean =>
    !words || `${group}.${key} ${schema.description ?? ""}`.toLowerCase().includes(words.toLowerCase());
  const knob = (group: string, key: string, schema: Schema, fallback: unknown) => {
    const given = group ? ((value[group] ?? {}) as Record<string, unknown>)[key] : value[key];
    const change = (now: unknown): void => (group ? set(group, key, now) : set(key, null, now));
    const name = group ? `${group}.${key}` : key;
    return has(group, key, schema) && (
      <div key={key} data-field={name} class={name === at ? "fault" : ""}>
        <Field api={api} schema={schema} name={name} value={given} fallback={fallback} isChanged={given !== undefined} onReset={() => change(undefined)} onChange={change} />
      </div>
    );
  };
  return (
    <div class="params">
      <label><span>{text.create.search}</span><input type="search" value={words} onInput={(event) => setWords(event.currentTarget.value)} /></label>
      {scalars.map(([key, schema]) => knob("", key, schema, schema.default))}
      {groups.filter(([, schema]) => isNested(api, schema)).map(([group, schema]) => {
        const inner = resolved(api, schema);
        const fields = Object.entries(inner.properties!).map(([key, field]) =>
          knob(group, key, field, (schema.default as Record<string, unknown> | undefined)?.[key] ?? field.default)).filter(Boolean);
        const changed = Object.keys((value[group] ?? {}) as object).length;
        return fields.length > 0 && (
          <details key={`${group}${words !== ""}`} open={words !== "" || changed > 0 || at?.split(".")[0] === group}>
            <summary>{group} <span class="soft">{prose(inner.description?.split("\n")[0])}{changed > 0 && ` · ${text.create.changed(changed)}`}</span></summary>
            {fields}
          </details>
        );
      })}
    </div>
  );
}

/** Returns true if two values of JSON say the same, in whichever order their keys stand. */
function isSame(a: unknown, b: unknown): boolean {
  if (typeof a !== "object" || typeof b !== "object" || !a || !b) return (a ?? null) === (b ?? null);
  const [one, two] = [a, b] as Record<string, unknown>[];
  return [...new Set([...Object.keys(one!), ...Object.keys(two!)])].every((key) => isSame(one![key], two![key]));
}

/** What of `params` is not at its default, as `group.key` and value; an object within a group is one value. */
export function changesOf(api: Api, params: Record<string, unknown>): Record<string, unknown> {
  const changes: Record<string, unknown> = {};
  const root = resolved(api, { $ref: "PlanParams" }).properties ?? {};
  const differs = (value: unknown, standard: unknown): boolean =>
    !isSame(value, standard) && !(Array.isArray(value) && value.length === 0 && standard == null);
  for (const [group, schema] of Object.entries(root)) {
    if (!(group in params)) continue;
    if (!isNested(api, schema)) {
      if (differs(params[group], schema.default)) changes[group] = params[group];
      continue;
    }
    for (const [key, field] of Object.entries(resolved(api, schema).properties!)) {
      const value = (params[group] as Record<string, unknown> | null)?.[key];
      const standard = field.default ?? (schema.default as Record<string, unknown> | undefined)?.[key];
      if (value !== undefined && differs(value, standard)) changes[`${group}.${key}`] = value;
    }
  }
  return changes;
}

/** `{"group.key": value}` as nested objects. */
export function nested(changes: Record<string, unknown>): Record<string, unknown> {
  const made: Record<string, unknown> = {};
  for (const [path, value] of Object.entries(changes)) {
    const [group, key] = path.split(".") as [string, string | undefined];
    if (key === undefined) made[group] = value;
    else made[group] = { ...(made[group] as object), [key]: value };
  }
  return made;
}

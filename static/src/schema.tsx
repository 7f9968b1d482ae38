// Forms made from the server's own schema: ranges, defaults and help are those of the API document.
import { useState } from "preact/hooks";
import { ask } from "./api";
import { text } from "./text";

export interface Schema {
  $ref?: string; type?: string | string[]; enum?: (string | number)[]; properties?: Record<string, Schema>; required?: string[];
  oneOf?: Schema[]; anyOf?: Schema[]; allOf?: Schema[]; items?: Schema; minimum?: number; maximum?: number; default?: unknown;
  description?: string; minItems?: number; maxItems?: number; maxLength?: number;
}
export interface Api { components: { schemas: Record<string, Schema> } }

let asked: Promise<Api> | null = null;
export const apiDocument = (): Promise<Api> => (asked ??= ask<Api>("/openapi.json"));

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

/** Range, default and unit, which descriptions end with. */
function hint(schema: Schema, fallback: unknown): string {
  const range = schema.minimum !== undefined && schema.maximum !== undefined ? `${schema.minimum} to ${schema.maximum}` : "";
  const standard = fallback === undefined || fallback === null ? "" : `${text.create.default} ${JSON.stringify(fallback)}`;
  return [range, standard].filter(Boolean).join(" · ");
}

function JsonField({ value, onChange, label, rows = 2 }: { value: unknown; onChange: (value: unknown) => void; label: string; rows?: number }) {
  const [draft, setDraft] = useState(() => (value === undefined ? "" : JSON.stringify(value)));
  const [problem, setProblem] = useState("");
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
      <textarea aria-label={label} rows={rows} spellcheck={false} value={draft} onInput={(event) => take(event.currentTarget.value)} />
      {problem && <span class="problem">{problem}</span>}
    </>
  );
}

function NumberField({ schema, value, onChange, label, fallback }: {
  schema: Schema; value: unknown; onChange: (value: unknown) => void; label: string; fallback?: unknown;
}) {
  return (
    <input type="number" aria-label={label} step={typeOf(schema) === "integer" ? 1 : "any"} min={schema.minimum} max={schema.maximum}
      value={typeof value === "number" ? value : ""} placeholder={fallback === undefined || fallback === null ? "" : String(fallback)}
      onInput={(event) => onChange(event.currentTarget.value === "" ? undefined : event.currentTarget.valueAsNumber)} />
  );
}

function Numbers({ value, onChange, label, count }: { value: unknown; onChange: (value: unknown) => void; label: string; count: number }) {
  const numbers = Array.isArray(value) ? (value as number[]) : Array<number>(count).fill(0);
  return (
    <span class="numbers">
      {numbers.map((number, i) => (
        <input key={i} type="number" step="any" aria-label={`${label} ${i + 1}`} value={number}
          onInput={(event) => onChange(numbers.map((old, at) => (at === i ? event.currentTarget.valueAsNumber : old)))} />
      ))}
    </span>
  );
}

function Checks({ choices, value, onChange }: { choices: string[]; value: string[]; onChange: (value: unknown) => void }) {
  return (
    <span class="checks">
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
    return <Checks choices={items.enum.map(String)} value={(value ?? fallback ?? []) as string[]} onChange={onChange} />;
  }
  const isFixed = schema.minItems !== undefined && schema.minItems === schema.maxItems && schema.minItems <= 7;
  if (type === "array" && isFixed && ["number", "integer"].includes(typeOf(items ?? {}))) {
    return <Numbers value={value} onChange={onChange} label={name} count={schema.minItems!} />;
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
      {schema.description && <p class="soft">{schema.description.replaceAll("\n", " ")}</p>}
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
      <span class="help">{schema.description?.replaceAll("\n", " ")} <em>{hint(schema, fallback)}</em>
        {props.isChanged && props.onReset && <button type="button" class="link" onClick={props.onReset}>{text.create.reset}</button>}
      </span>
    </div>
  );
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
      {Object.entries(whole.properties ?? {}).map(([key, inner]) => (
        <Field key={key} api={api} schema={inner} name={key} value={object[key]} fallback={standard[key]} onChange={(given) => set(key, given)} />
      ))}
    </fieldset>
  );
}

const isNested = (api: Api, schema: Schema): boolean => Boolean(resolved(api, schema).properties);

/** Parameters by group; holds only what is changed. */
export function ParamForm({ api, value, onChange }: {
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
    return has(group, key, schema) && (
      <Field key={`${key}${given === undefined}`} api={api} schema={schema} name={group ? `${group}.${key}` : key} value={given} fallback={fallback}
        isChanged={given !== undefined} onReset={() => change(undefined)} onChange={change} />
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
          <details key={`${group}${words !== ""}`} open={words !== "" || changed > 0}>
            <summary>{group} <span class="soft">{inner.description?.split("\n")[0]}{changed > 0 && ` · ${text.create.changed(changed)}`}</span></summary>
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

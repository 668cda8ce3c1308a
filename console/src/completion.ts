// Suggestions for a place of a protocol file, by its JSON schema: keys where a key belongs, values after a colon.
interface Schema {
  properties?: Record<string, Schema>;
  additionalProperties?: Schema | boolean;
  items?: Schema;
  enum?: unknown[];
  const?: unknown;
  anyOf?: Schema[];
  oneOf?: Schema[];
  allOf?: Schema[];
  $ref?: string;
  $defs?: Record<string, Schema>;
  description?: string;
}
export interface Completion {
  text: string;
  description: string;
}

/** The keys around the line at `at`, outermost first, by the indentation of block YAML, and the word begun there. */
export function pathAt(text: string, at: number): { path: string[]; begun: string; isValue: boolean } {
  const before = text.slice(0, at);
  const lines = before.split("\n");
  const current = lines.pop() ?? "";
  const value = /^(\s*(?:- )?)([\w-]+):\s+(\S*)$/.exec(current);
  const inner = /[{,]\s*([\w-]*)$/.exec(current);
  const innerValue = /[{,]\s*([\w-]+):\s*([\w./-]*)$/.exec(current);
  const key = /^(\s*)(?:- )?([\w-]*)$/.exec(current);
  let indent = /^\s*/.exec(current)![0].length;
  const path: string[] = [];
  for (const line of lines.reverse()) {
    const found = /^(\s*)(?:- )?([\w-]+):/.exec(line);
    if (!found || /^\s*#/.test(line) || found[1]!.length >= indent) continue;
    indent = found[1]!.length;
    path.unshift(found[2]!);
  }
  if (innerValue || inner) {
    const own = /^\s*(?:- )?([\w-]+):/.exec(current);
    if (own) path.push(own[1]!);
    if (innerValue && (!inner || innerValue.index >= inner.index))
      return { path: [...path, innerValue[1]!], begun: innerValue[2]!, isValue: true };
    return { path, begun: inner![1]!, isValue: false };
  }
  if (value) return { path: [...path, value[2]!], begun: value[3]!, isValue: true };
  return { path, begun: key?.[2] ?? "", isValue: false };
}

export function complete(schema: unknown, text: string, at: number): Completion[] {
  const root = schema as Schema;
  const { path, begun, isValue } = pathAt(text, at);
  let places = spread(root, root);
  for (const key of path) {
    const next: Schema[] = [];
    for (const place of places) {
      const inner =
        place.properties?.[key] ?? (typeof place.additionalProperties === "object" ? place.additionalProperties : null);
      if (inner) next.push(...spread(root, inner));
    }
    places = next.flatMap((place) => (place.items ? [place, ...spread(root, place.items)] : [place]));
  }
  const found = new Map<string, string>();
  for (const place of places) {
    if (isValue)
      for (const value of [...(place.enum ?? []), ...(place.const === undefined ? [] : [place.const])])
        found.set(String(value), place.description ?? "");
    else
      for (const [name, inner] of Object.entries(place.properties ?? {}))
        found.set(name, inner.description ?? spread(root, inner)[0]?.description ?? "");
  }
  return [...found]
    .filter(([name]) => name.startsWith(begun) && name !== begun)
    .slice(0, 12)
    .map(([name, description]) => ({ text: name, description }));
}

/** A schema without references and alternatives: every one that it can be. */
function spread(root: Schema, schema: Schema, depth = 0): Schema[] {
  if (depth > 8) return [];
  if (schema.$ref) {
    const name = schema.$ref.replace("#/$defs/", "");
    const inner = root.$defs?.[name];
    return inner ? spread(root, inner, depth + 1) : [];
  }
  const parts = [...(schema.anyOf ?? []), ...(schema.oneOf ?? []), ...(schema.allOf ?? [])];
  return [schema, ...parts.flatMap((part) => spread(root, part, depth + 1))];
}

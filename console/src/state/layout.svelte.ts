// Which fields are plotted where. Kept for each protocol in this browser, and shared as a file.
import { chooseColours, COLOURS } from "../colours";
import { columnsOf, type Field, type Protocol } from "../protocol";

export interface PlotLayout {
  id: string;
  fields: string[];
}
export interface LayoutFile {
  wirebond_layout: 1;
  protocol: string;
  seconds: number;
  table?: boolean;
  plots: { fields: string[] }[];
  colours?: Record<string, number>; // of fields
}
const DEFAULT_SECONDS = 10;
const MOST_FIELDS = 64; // of all plots, as the server allows
const MOST_PLOTS = 32;
const FIRST_FIELDS = 6; // of the plots that are there before the reader made one

export class Layout {
  plots = $state<PlotLayout[]>([]);
  seconds = $state(DEFAULT_SECONDS);
  hasTable = $state(false);
  /** Of each plotted field: which colour it has in all plots. */
  colours = $state.raw<ReadonlyMap<string, number>>(new Map());
  private protocol = "";
  private next = 1;

  /** The layout of this protocol: the saved one, or one made from the robot's regular messages. */
  open(protocol: Protocol): void {
    if (this.protocol === protocol.name) return;
    this.protocol = protocol.name;
    const saved = localStorage.getItem(this.key());
    try {
      if (saved !== null) {
        this.read(JSON.parse(saved), protocol);
        return;
      }
    } catch {
      // an unreadable layout is as none
    }
    this.plots = [];
    this.colours = new Map();
    const regular = columnsOf(protocol).filter(
      ({ message, field }) =>
        message.sender === "mcu" && message.every !== null && field.kind === "number" && !field.is_time,
    );
    const byUnit = new Map<string, string[]>();
    // An array is taken whole.
    const first = regular.filter(
      ({ field }, at) => regular.findIndex((one) => one.field === field) < FIRST_FIELDS && at < MOST_FIELDS,
    );
    for (const { column, field, message } of first) {
      const key = `${message.name} ${field.unit ?? ""}`;
      byUnit.set(key, [...(byUnit.get(key) ?? []), column]);
    }
    for (const fields of [...byUnit.values()].slice(0, 3)) this.plots.push({ id: this.newId(), fields });
    this.colour();
  }

  add(fields: string[] = []): void {
    if (this.plots.length < MOST_PLOTS) this.plots.push({ id: this.newId(), fields: [] });
    const plot = this.plots.at(-1);
    if (plot) this.put(plot.id, fields);
  }

  put(id: string, fields: string[]): void {
    const plot = this.plots.find((one) => one.id === id);
    if (!plot) return;
    const room = MOST_FIELDS - this.plots.reduce((count, one) => count + one.fields.length, 0);
    plot.fields = [
      ...plot.fields,
      ...fields.filter((field) => !plot.fields.includes(field)).slice(0, Math.max(0, room)),
    ];
    this.save();
  }

  take(id: string, field: string): void {
    const plot = this.plots.find((one) => one.id === id);
    if (plot) plot.fields = plot.fields.filter((one) => one !== field);
    this.save();
  }

  remove(id: string): void {
    this.plots = this.plots.filter((one) => one.id !== id);
    this.save();
  }

  show(seconds: number): void {
    this.seconds = seconds;
    this.save();
  }

  showTable(isShown: boolean): void {
    this.hasTable = isShown;
    this.save();
  }

  file(): LayoutFile {
    const plots = this.plots.map(({ fields }) => ({ fields: [...fields] }));
    const { protocol, seconds, hasTable: table } = this;
    return { wirebond_layout: 1, protocol, seconds, table, plots, colours: Object.fromEntries(this.colours) };
  }

  /** Takes a layout over. Returns the fields that this protocol does not have. Throws its fault. */
  read(file: unknown, protocol: Protocol): string[] {
    const layout = file as Partial<LayoutFile> | null;
    if (layout?.wirebond_layout !== 1 || !Array.isArray(layout.plots)) throw new Error("no wirebond_layout: 1");
    const known = new Set(columnsOf(protocol).map(({ column }) => column));
    const missing: string[] = [];
    this.plots = layout.plots.slice(0, MOST_PLOTS).map((plot) => {
      const fields = (Array.isArray(plot.fields) ? plot.fields : []).filter((field) => typeof field === "string");
      missing.push(...fields.filter((field) => !known.has(field)));
      return { id: this.newId(), fields: fields.filter((field) => known.has(field)) };
    });
    this.hasTable = layout.table === true;
    const colours = Object.entries(layout.colours ?? {});
    this.colours = new Map(colours.filter(([, index]) => Number.isInteger(index) && index >= 0 && index < COLOURS));
    this.colour();
    if (typeof layout.seconds === "number" && layout.seconds > 0) this.seconds = layout.seconds;
    return missing;
  }

  save(): void {
    this.colour();
    localStorage.setItem(this.key(), JSON.stringify(this.file()));
  }

  private colour(): void {
    this.colours = chooseColours(
      this.plots.map(({ fields }) => fields),
      this.colours,
    );
  }

  private key = () => `wirebond.layout.${this.protocol}`;
  private newId = () => `p${this.next++}`;
}
export const layout = new Layout();

/** Each column of a protocol that can be plotted, with its field. */
export function columnTable(protocol: Protocol | null): Map<string, Field> {
  const all = protocol ? columnsOf(protocol) : [];
  return new Map(
    all
      .filter(({ field }) => field.kind !== "text" && field.kind !== "bytes")
      .map(({ column, field }) => [column, field]),
  );
}

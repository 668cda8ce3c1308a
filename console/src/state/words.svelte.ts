// The texts of the reader's language. The browser's language decides, unless the reader chose one.
import { en, type Texts } from "../texts/en";
import { zh } from "../texts/zh";

export type Language = "en" | "zh";
const KEY = "wirebond.language";
const tables: Record<Language, Texts> = { en, zh };

class Words {
  language = $state<Language>(first());
  readonly t = $derived(tables[this.language]);

  choose(language: Language): void {
    this.language = language;
    localStorage.setItem(KEY, language);
  }
}
function first(): Language {
  const chosen = localStorage.getItem(KEY);
  if (chosen === "en" || chosen === "zh") return chosen;
  return navigator.language.toLowerCase().startsWith("zh") ? "zh" : "en";
}
export const words = new Words();

/** What the server says under this key, in the reader's language where it has it: `text`, and `text_zh` beside it. */
export function said(told: object, key: string): string {
  const all = told as Record<string, unknown>;
  const found = (words.language === "zh" ? all[`${key}_zh`] : null) ?? all[key];
  return typeof found === "string" ? found : "";
}

/** The same of several sentences. */
export function allSaid(told: object, key: string): string[] {
  const all = told as Record<string, unknown>;
  return ((words.language === "zh" ? all[`${key}_zh`] : null) ?? all[key] ?? []) as string[];
}

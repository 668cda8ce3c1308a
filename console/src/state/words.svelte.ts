// The texts of the reader's language. The browser's language decides, unless the reader chose one.
import type { Chinese } from "../chinese";
import { en, type Texts } from "../texts/en";
import { zh } from "../texts/zh";

export type Language = "en" | "zh";
const KEY = "wirebond.language";
const tables: Record<Language, Texts> = { en, zh };

class Words {
  /** For sentences that come in English alone; null: a server sends both. */
  chinese: Chinese | null = null;
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

/** The sentence under this key, in the reader's language if there is one: `text`, and `text_zh` beside it. */
export function said(told: object, key: string): string {
  const all = told as Record<string, unknown>;
  const english = all[key];
  if (words.language === "zh") {
    const found = all[`${key}_zh`] ?? (typeof english === "string" ? words.chinese?.find(english) : null);
    if (typeof found === "string") return found;
  }
  return typeof english === "string" ? english : "";
}

/** The same of several sentences. */
export function allSaid(told: object, key: string): string[] {
  const all = told as Record<string, unknown>;
  const english = (all[key] ?? []) as string[];
  if (words.language === "en") return english;
  return (all[`${key}_zh`] as string[] | undefined) ?? english.map((one) => words.chinese?.find(one) ?? one);
}

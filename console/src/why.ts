// Why a link is as it is, as a sentence: the server's, where it has one.
import { ageText } from "./protocol";
import type { Texts } from "./texts/en";
import { said } from "./state/words.svelte";
import type { LinkView } from "./views";

export function whyOf(link: LinkView, texts: Texts["stale"], now: number): string {
  if (link.why || link.state !== "stale") return said(link, "why");
  if (link.heard !== null) return texts.silent(ageText(Math.max(0, now - link.heard)));
  return Number(link.receive.bytes) > 0 ? texts.noFrame : texts.noByte;
}

// Does a command reach the robot at this moment, as far as the page knows?
import type { Texts } from "../texts/en";
import { live } from "./live.svelte";
import { session } from "./session.svelte";
import { said } from "./words.svelte";

/** Why not: in short, and as a sentence with the cause. null: it does. */
export function unreached(texts: Texts["control"]): { short: string; why: string } | null {
  if (!live.isHeard || session.phase !== "attached") return { short: texts.noServer, why: texts.noServerWhy };
  if (!live.link?.connected) return { short: texts.noPort, why: texts.noPort };
  if (live.link.state === "down") return { short: texts.noRobot, why: texts.noRobotWhy(said(live.link, "why")) };
  return null;
}

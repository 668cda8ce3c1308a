// What happened, in the reader's language: the server's events have their facts beside an English sentence.
import { ageText, type Protocol } from "./protocol";
import type { Texts } from "./texts/en";
import { said } from "./state/words.svelte";
import type { LinkEvent } from "./views";

export function eventText(event: LinkEvent, texts: Texts["happened"], protocol: Protocol | null): string {
  const fact = (name: string) => (typeof event[name] === "string" ? (event[name] as string) : "");
  const why = (words: Record<string, string>) => words[fact("why")] ?? fact("why").replaceAll("_", " ");
  switch (event.kind) {
    case "port_up":
      return texts.portUp;
    case "port_down":
      return texts.portDown(said(event, "why"));
    case "port_settings":
      return texts.portSettings;
    case "stopped":
      return texts.stopped;
    case "released":
      return texts.released;
    case "stop released":
      return texts.releasedBy(fact("by"), fact("over"));
    case "deadline_struck": {
      const deadline = protocol?.deadlines.find((one) => one.at === "host" && one.then === fact("action"));
      return deadline ? texts.missed(deadline.then, deadline.message, ageText(deadline.after)) : event.text;
    }
    case "mcu_deadline_struck": {
      const rule = protocol?.deadlines.find(
        (one) => one.at === "mcu" && one.then === fact("action") && one.message === fact("message"),
      );
      return texts.missedByRobot(fact("action"), fact("message"), rule ? ageText(rule.after) : "?");
    }
    case "discarded":
      return texts.discarded(Number(event.bytes), event.direction === "sent");
    case "log":
      return `${texts.levels[fact("level")] ?? fact("level")}: ${event.text}`;
    case "deadline_ended":
      return texts.missedNoMore(fact("action"));
    case "lease_begun":
      return texts.repeated(fact("message"));
    case "lease_ended":
      return texts.repeatedNoMore(fact("message"), why(texts.whyEnded));
    case "control":
      return texts.control(fact("holder"), why(texts.whyControl));
    default:
      return event.text; // of a program, of the robot or of a person: in their words
  }
}

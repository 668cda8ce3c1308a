// What is typed into the form of a message. It stays while the page is open: a look at another view does not lose it, and
// a repetition that is begun afterwards does not send zeros.
import { headerFields, initialFields, type Header, type Message, type Protocol } from "../protocol";

export interface Form {
  values: Record<string, unknown>;
  header: Header;
}
const kept = new Map<string, Form>();
const key = (protocol: Protocol | null, message: Message) => JSON.stringify([protocol?.hash, message]);

/** The form as it was left; of a message whose file has changed, or that was not touched, with its defaults. */
export function formOf(protocol: Protocol | null, message: Message): Form {
  return (
    kept.get(key(protocol, message)) ?? {
      values: initialFields(message.fields),
      header: initialFields(headerFields(protocol)),
    }
  );
}

export function keepForm(protocol: Protocol | null, message: Message, form: Form): void {
  kept.set(key(protocol, message), form);
}

// A view of the server, for the component that shows it.
import { live } from "./live.svelte";

/** What the server says about this view while the component is on the page: the newest message, null before the first.
 *
 * `wish`: the server's input for it, as in docs/console-api.md. */
export function shown<Message>(view: string, wish: unknown = true): { readonly value: Message | null } {
  $effect(() => live.show(view, wish));
  return {
    get value() {
      return (live.newest[view] as Message | undefined) ?? null;
    },
  };
}

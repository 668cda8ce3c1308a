// What a panel of the Link view says about itself. Each component of this folder is one; nothing else names it.
import type { Component } from "svelte";

export interface Panel {
  /** Order of the panels. */
  order: number;
  /** Its width, of 12. */
  columns: number;
  /** The same while the link has no protocol, and most panels are gone. */
  alone?: number;
  /** Without this it is not there. */
  needs: "nothing" | "link" | "protocol";
}

export interface PanelFile {
  default: Component;
  panel: Panel;
}

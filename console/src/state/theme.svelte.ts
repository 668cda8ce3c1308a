// Light or dark: by the system, unless the reader chose one.
export type Theme = "system" | "light" | "dark";
const KEY = "wirebond.theme";
const system = matchMedia("(prefers-color-scheme: dark)");

class ThemeState {
  choice = $state<Theme>((localStorage.getItem(KEY) as Theme | null) ?? "system");
  private systemIsDark = $state(system.matches);
  readonly isDark = $derived(this.choice === "dark" || (this.choice === "system" && this.systemIsDark));

  constructor() {
    system.addEventListener("change", () => {
      this.systemIsDark = system.matches;
    });
  }

  choose(choice: Theme): void {
    this.choice = choice;
    localStorage.setItem(KEY, choice);
  }

  /** The theme that is not shown. */
  toggle(): void {
    this.choose(this.isDark ? "light" : "dark");
  }
}
export const theme = new ThemeState();

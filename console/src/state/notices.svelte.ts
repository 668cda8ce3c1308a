// Sentences about recent events. Each goes after a while, or when it is clicked.
export interface Notice {
  id: number;
  text: string;
  tone: "calm" | "bad";
  count: number;
}
const STAY = 7000; // ms
const MOST = 4;

class Notices {
  all = $state<Notice[]>([]);
  private next = 1;

  say(text: string, tone: Notice["tone"] = "calm"): void {
    const same = this.all.find((notice) => notice.text === text);
    const id = this.next++; // of one that is said again, too: it stays as long as a new one
    const count = same ? same.count + 1 : 1;
    this.all = [...this.all.filter((notice) => notice !== same).slice(1 - MOST), { id, text, tone, count }];
    setTimeout(() => this.drop(id), STAY);
  }

  drop(id: number): void {
    this.all = this.all.filter((notice) => notice.id !== id);
  }
}
export const notices = new Notices();

// The time of a page, in seconds. It goes on while the computer sleeps, which `performance.now` does not on all systems:
// a lease that was given before must have ended after.
const SLEPT = 1000; // ms that the clock of the day is ahead, after which the computer must have slept

export class Clock {
  private ahead = 0; // ms
  private wall: number;
  private steady: number;

  constructor(
    private readonly wallNow: () => number = () => Date.now(),
    private readonly steadyNow: () => number = () => performance.now(),
  ) {
    this.wall = wallNow();
    this.steady = steadyNow();
  }

  now(): number {
    const wall = this.wallNow();
    const steady = this.steadyNow();
    const slept = wall - this.wall - (steady - this.steady);
    if (slept > SLEPT) this.ahead += slept;
    this.wall = wall;
    this.steady = steady;
    return (steady + this.ahead) / 1000;
  }

  /** What to add to a time for seconds since 1970. */
  get wallAhead(): number {
    return this.wallNow() / 1000 - this.now();
  }
}

// When a page gets its connection back: which step it takes at which moment. Pure: time, chance and what happened come in.
//
//   connecting --connected--> live --lost--> apart --its wait is over, the robot answers--> connecting
//   connecting --failed--> apart, with a longer wait
//   connecting --the robot knows this page no more--> anew --its wait is over--> asking (for the robot's turn)
//   asking --turn given--> turn --its moment has come--> leaving (the browser loads the page again)
//   asking --refused--> anew, with a longer wait;   leaving --still here after a while--> anew
//
// Waits grow and are spread by chance: a class that lost its robot in one moment does not come back in one moment.
class MsbotReconnect {
  static FIRST_MS = 500;
  static GROWS = 1.7;
  static LONGEST_MS = 8000;
  static SPREAD_MS = 800;  // after the robot has been away: within so long all pages of all browsers try
  static HIDDEN_MS = 1500;  // a tab that nobody looks at lets the others go first
  static LEAVING_MS = 15000;

  constructor(chance = Math.random) {
    this.chance = chance;
    this.state = "connecting";
    this.failures = 0;
    this.at = Infinity;
  }

  connected() {
    this.state = "live";
    this.failures = 0;
    this.at = Infinity;
  }

  // The connection broke, or did not come up.
  lost(now) {
    if (this.state === "live") this.failures = 0;
    else if (this.state !== "connecting") return;
    this.state = "apart";
    this.at = now + this.wait();
  }

  // The robot does not know this page: it has been started anew, or the page was away for too long.
  gone(now, isHidden) {
    this.state = "anew";
    this.failures = 0;
    this.at = now + this.chance() * MsbotReconnect.FIRST_MS + (isHidden ? MsbotReconnect.HIDDEN_MS : 0);
  }

  // The robot answers after a silence: what had grown meanwhile is no measure any more.
  back(now) {
    if (this.state !== "apart" && this.state !== "anew") return;
    this.failures = 0;
    this.at = now + this.chance() * MsbotReconnect.SPREAD_MS;
  }

  turn(now, inMs) {
    if (this.state !== "asking") return;
    this.state = "turn";
    this.at = now + inMs;
  }

  refused(now) {
    if (this.state !== "asking") return;
    this.state = "anew";
    this.at = now + this.wait();
  }

  // Another tab of this browser is being made anew: that is no failure.
  later(now) {
    if (this.state !== "asking") return;
    this.state = "anew";
    this.at = now + MsbotReconnect.FIRST_MS * (0.5 + this.chance());
  }

  // The step that is due: "connect", "turn" (ask for it), "reload", or "".
  step(now, answers) {
    if (now < this.at || (!answers && this.state !== "leaving")) return "";
    switch (this.state) {
      case "apart":
        this.state = "connecting";
        this.at = Infinity;
        return "connect";
      case "anew":
        this.state = "asking";
        this.at = Infinity;
        return "turn";
      case "turn":
        this.state = "leaving";
        this.at = now + MsbotReconnect.LEAVING_MS;
        return "reload";
      case "leaving":
        this.state = "anew";
        this.at = now + this.wait();
        return "";
      default:
        return "";
    }
  }

  wait() {
    const { FIRST_MS, GROWS, LONGEST_MS } = MsbotReconnect;
    const ms = Math.min(FIRST_MS * GROWS ** this.failures, LONGEST_MS);
    this.failures += 1;
    return ms * (0.5 + this.chance());
  }
}
globalThis.MsbotReconnect = MsbotReconnect;

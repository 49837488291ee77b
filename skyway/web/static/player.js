// The player of the replay page: one or two logs, a time, and everything at that time. It runs in the browser alone.
import { h } from "vue";
import { lines, marks } from "skyway-map/traces.js";
import { inWords, zoneName } from "skyway-flight/words.js";

const SPEEDS = [-60, -10, -1, 1, 5, 10, 30, 60, 120];
const COLOURS = ["vehicle", "start"];
const AWAY_DEG = 2; // a log from farther outside the region is not of its zone of time

// Two logs are put together where they took off first: the one that did so sooner after its begin is moved in time.
function together(log, logs) {
  const begun = logs.map((one) => one.flights[0]?.[0]);
  const shift = log.flights.length && begun.every((one) => one !== undefined) ? Math.max(...begun) - log.flights[0][0] : 0;
  if (!shift) return log;
  const later = (one) => Math.round(100 * (one + shift)) / 100;
  return {
    ...log,
    begin_s: log.begin_s === null ? null : log.begin_s - shift,
    columns: { ...log.columns, time_s: log.columns.time_s.map(later) },
    events: log.events.map((one) => ({ ...one, time_s: later(one.time_s) })),
    flights: log.flights.map((pair) => pair.map(later)),
  };
}

function counter(seconds) {
  const whole = Math.max(0, Math.round(seconds));
  return `${Math.floor(whole / 3600)}:${String(Math.floor(whole / 60) % 60).padStart(2, "0")}:${String(whole % 60).padStart(2, "0")}`;
}

// A component of its own: a log has thousands of events, and they are drawn anew only when another one is under way, not in each frame.
const EventList = {
  props: { events: Array, here: Number, from: Number, before: Number, view: Object },
  emits: ["go"],
  render() {
    const row = (one, i) =>
      h("li", { class: i >= this.from && i < this.before ? "now" : "" }, [
        h("button", { type: "button", class: "plain", tabindex: i === this.here ? 0 : -1, onClick: () => this.$emit("go", one.time_s) }, counter(one.time_s)),
        ` ${inWords(one.text, this.view)}`,
      ]);
    return h("ol", { class: "events", "aria-label": "Events", onKeydown: (e) => this.along(e) }, this.events.map(row));
  },
  methods: {
    // Tab leads to one of them, the last that was; arrows lead on.
    along(e) {
      const way = { ArrowDown: 1, ArrowUp: -1 }[e.key];
      if (!way) return;
      const all = [...e.currentTarget.querySelectorAll("button")];
      all[all.indexOf(document.activeElement) + way]?.focus();
      e.preventDefault();
    },
  },
};

export default {
  props: { speedUnit: String, speedFactor: Number, heightUnit: String, heightFactor: Number, utc: Boolean, zone: String, bounds: Array },
  emits: ["failed"],
  data() {
    return { logs: [], at: 0, speed: 10, playing: false, reading: "" };
  },
  computed: {
    end() {
      return Math.max(1, ...this.logs.map((log) => log.columns.time_s.at(-1)));
    },
    view() {
      return { speedUnit: this.speedUnit, speedFactor: this.speedFactor, heightUnit: this.heightUnit, heightFactor: this.heightFactor };
    },
    // The zone of time is that of the region; a log from elsewhere is in UTC.
    clockOf() {
      const { lat, lon } = this.logs[0].columns;
      const k = lat.findIndex((one, i) => one !== null && lon[i] !== null);
      const [west, south, east, north] = this.bounds || [-180, -90, 180, 90];
      const inside = (x, low, high) => x >= low - AWAY_DEG && x <= high + AWAY_DEG;
      return { utc: this.utc || (k >= 0 && !(inside(lat[k], south, north) && inside(lon[k], west, east))), zone: this.zone };
    },
    // Of all logs, in the order of time; which log each is of stands before it where there are two.
    events() {
      const all = this.logs.flatMap((log, i) => log.events.map((one) => ({ time_s: one.time_s, text: this.logs.length > 1 ? `log ${i + 1}: ${one.text}` : one.text })));
      return all.sort((a, b) => a.time_s - b.time_s);
    },
  },
  render() {
    const reading = h("p", { class: this.reading ? "status" : "only-heard", role: "status" }, this.reading && `Reading ${this.reading} …`);
    if (!this.logs.length) return h("div", { class: "player" }, [reading]);
    const button = (words, act, title) => h("button", { type: "button", onClick: act, title, "aria-label": title }, words);
    return h("div", { class: "player" }, [
      reading,
      h("div", { class: "line" }, [
        button("|<", () => this.jump(0), "To the beginning"),
        button("<", () => this.jump(this.nextEvent(-1)), "Event before"),
        h("button", { type: "button", class: "main", onClick: () => this.toggle(), "data-keys": " " }, this.playing ? "Pause" : "Play"),
        button(">", () => this.jump(this.nextEvent(1)), "Next event"),
        h("label", { for: "player-speed", class: "faint" }, "Speed"),
        h(
          "select",
          { id: "player-speed", value: this.speed, onChange: (e) => (this.speed = Number(e.target.value)) },
          SPEEDS.map((one) => h("option", { value: one }, one < 0 ? `${-one} x backwards` : `${one} x`)),
        ),
        h("output", { class: "clock", "aria-live": "off" }, this.clock(this.at)),
      ]),
      h("input", {
        type: "range", min: 0, max: this.end, step: this.end / 2000, value: this.at, "aria-label": "Time of the log",
        "aria-valuetext": this.clock(this.at), onInput: (e) => this.jump(Number(e.target.value)),
      }),
      h("div", { class: "nows" }, this.logs.map((log, i) => this.now(log, i))),
      ...this.logs.filter((log) => log.notes.length).map((log) => this.notes(log)),
      h("div", { class: "traces" }, this.traces()),
      h(EventList, { events: this.events, ...this.nowOfEvents(), view: this.view, onGo: this.jump }),
    ]);
  },
  mounted() {
    this.last = 0;
    this.tick = (time) => {
      if (this.playing) this.step((time - this.last) / 1000);
      this.last = time;
      this.frame = requestAnimationFrame(this.tick);
    };
    this.frame = requestAnimationFrame(this.tick);
    window.skywayPlayer = this;
  },
  unmounted() {
    cancelAnimationFrame(this.frame);
  },
  methods: {
    async open(names) {
      const logs = [];
      this.asked?.abort(); // what was chosen before comes too late
      const asked = (this.asked = new AbortController());
      try {
        for (const name of names) {
          this.reading = name;
          const answer = await fetch(`/api/replay?log=${encodeURIComponent(name)}`, { signal: asked.signal });
          const told = await answer.json();
          if (answer.ok) logs.push(told);
          else this.$emit("failed", told.error);
        }
      } catch (error) {
        if (!asked.signal.aborted) this.$emit("failed", `the page's server does not answer: ${error.message}`);
      }
      if (asked.signal.aborted) return;
      this.reading = "";
      this.logs = logs.map((log) => Object.freeze(together(log, logs)));
      this.at = 0;
      this.playing = false;
      this.drawn = undefined;
      this.frameMap();
    },
    frameMap() {
      const places = this.logs.flatMap((log) => log.columns.lat.map((lat, i) => [lat, log.columns.lon[i]]).filter(([lat, lon]) => lat !== null && lon !== null));
      if (!places.length) return void window.skywayMap?.set({ tracks: [], vehicles: [], wind: null });
      const lat = places.map((p) => p[0]).sort((a, b) => a - b);
      const lon = places.map((p) => p[1]).sort((a, b) => a - b);
      const tracks = this.logs.map((log, i) => ({
        points: log.columns.lat.map((one, k) => [one, log.columns.lon[k]]).filter(([a, b]) => a !== null && b !== null),
        colour: COLOURS[i], width: 2, dash: i ? [6, 4] : [],
      }));
      window.skywayMap?.set({ tracks, bounds: [lon[0], lat[0], lon.at(-1), lat.at(-1)], fitted: true });
      this.show();
    },
    toggle() {
      if (!this.playing && this.speed > 0 && this.at >= this.end) this.at = 0;
      this.playing = !this.playing;
    },
    step(seconds) {
      this.at = Math.max(0, Math.min(this.end, this.at + seconds * this.speed));
      if (this.at === 0 || this.at === this.end) this.playing = false;
      this.show();
    },
    jump(to) {
      this.at = Math.max(0, Math.min(this.end, to));
      this.show();
    },
    nextEvent(way) {
      const times = this.events.map((one) => one.time_s);
      return way > 0 ? (times.find((t) => t > this.at + 0.05) ?? this.end) : (times.findLast((t) => t < this.at - 0.05) ?? 0);
    },
    row(log) {
      const times = log.columns.time_s;
      let [low, high] = [0, times.length - 1];
      while (low < high) {
        const middle = (low + high + 1) >> 1;
        if (times[middle] <= this.at) low = middle;
        else high = middle - 1;
      }
      return low;
    },
    // Whether it tells of this time: "" or what is shown in place of it.
    outside(log) {
      const { time_s } = log.columns;
      return this.at > time_s.at(-1) + 1 ? "ended: its last values" : this.at < time_s[0] - 1 ? "no telemetry yet: its first values" : "";
    },
    show() {
      if (!this.logs.length) return;
      const vehicles = this.logs.flatMap((log, i) => {
        const k = this.row(log);
        const c = log.columns;
        return c.lat[k] === null ? [] : [{ id: i, name: log.name, lat: c.lat[k], lon: c.lon[k], heading_deg: c.heading_deg[k], stale: Boolean(this.outside(log)) }];
      });
      const log = this.logs[0];
      const k = this.row(log);
      const [east, north] = [log.columns.wind_east_mps[k], log.columns.wind_north_mps[k]];
      const wind = east === null || !vehicles.length ? null : { points: [[vehicles[0].lat, vehicles[0].lon]], hours: [{ east: [east], north: [north] }] };
      window.skywayMap?.set({ vehicles, wind, hour: 0 });
    },
    clock(seconds) {
      const log = this.logs[0];
      const relative = counter(seconds);
      if (!log || log.begin_s === null) return relative;
      const zone = this.clockOf.utc ? "UTC" : this.zone;
      const day = new Date(1000 * (log.begin_s + seconds));
      const words = day.toLocaleString("sv-SE", { timeZone: zone, hour12: false });
      return `${relative} (${words} ${zoneName(log.begin_s + seconds, this.clockOf)})`;
    },
    now(log, i) {
      const k = this.row(log);
      const c = log.columns;
      const value = (x, factor, unit, digits = 1) => (x === null ? "unknown" : `${(x * factor).toFixed(digits)} ${unit}`);
      const wind = c.wind_north_mps[k] === null ? null : Math.hypot(c.wind_north_mps[k], c.wind_east_mps[k]);
      const from = wind === null ? "" : ` from ${String(Math.round(((Math.atan2(-c.wind_east_mps[k], -c.wind_north_mps[k]) * 180) / Math.PI + 360) % 360)).padStart(3, "0")}°`;
      const sure = c.wind_sigma_mps[k] === null ? "" : ` ± ${(c.wind_sigma_mps[k] * this.speedFactor).toFixed(1)}`;
      const health = c.health[k] === null ? "unknown" : c.health[k] ? "consistent" : "not consistent";
      const cells = [
        ["height", value(c.height_m[k], this.heightFactor, this.heightUnit, 0)],
        ["ground speed", value(c.ground_speed_mps[k], this.speedFactor, this.speedUnit)],
        ["charge", value(c.soc[k], 100, "%", 0)],
        ["wind", wind === null ? (c.health[k] === 0 ? "unknown" : "not measured") : `${(wind * this.speedFactor).toFixed(1)}${sure} ${this.speedUnit}${from}`],
        ["wind filter", health],
      ];
      return h("dl", { class: "figures", "aria-label": log.name }, [
        h("div", [h("dt", ["log", ` ${i + 1}`]), h("dd", { class: "small-dd" }, [log.name, h("span", { class: "small" }, this.outside(log))])]),
        ...cells.map(([name, words]) => h("div", [h("dt", name), h("dd", { class: "small-dd" }, words)])),
      ]);
    },
    // What is to be known of the log as a whole: how its wind was measured, and what its times are worth.
    notes(log) {
      const words = this.logs.length > 1 ? `${log.name}: ` : "";
      return h("ul", { class: "notes small-notes", "aria-label": `Notes on ${log.name}` }, log.notes.map((one) => h("li", { class: one.startsWith("warning") ? "warn" : "faint" }, `${words}${inWords(one, this)}`)));
    },
    traces() {
      this.drawn ||= ["height_m", "soc", "ground_speed_mps", "wind"].map((name) => lines(this.logs, name, this.end, this));
      return this.drawn.map((one) => marks(one, this.at / this.end, (share) => this.jump(share * this.end)));
    },
    // The last event that was, and those of this second: from one, before another.
    nowOfEvents() {
      const first = (late) => {
        const found = this.events.findIndex((one) => one.time_s > late);
        return found < 0 ? this.events.length : found;
      };
      return { here: Math.max(0, first(this.at + 0.05) - 1), from: first(this.at - 1), before: first(this.at + 1) };
    },
  },
};

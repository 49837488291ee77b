// Flights under way, one tab each, and vehicles that are heard: one digest a second for the map and the tables, one more for the flight that is open.
import { h, markRaw } from "vue";
import { keyOf, onMap, turn, vehicleTable } from "skyway-flight/vehicles.js";
import { alarms, flightView } from "skyway-flight/view.js";
import { inWords } from "skyway-flight/words.js";

const EVERY_MS = 1000;
const KEPT_ROWS = 4000;
const LONG_MS = 8000;
const AROUND = 0.01; // degrees around the way of a flight

const newId = () => [...crypto.getRandomValues(new Uint8Array(12))].map((one) => one.toString(16).padStart(2, "0")).join("");

export default {
  props: { speedUnit: String, speedFactor: Number, heightUnit: String, heightFactor: Number, utc: Boolean, zone: String, first: String },
  emits: ["resume"],
  data() {
    return { digest: { vehicles: [], watches: [], deliveries: [], flights: [] }, flight: null, open_: this.first || "", lost: false, sought: "", asked: [], wanted: "", charged: null, name: localStorage.getItem("skyway-name") || "" };
  },
  mounted() {
    this.courses = new Map();
    window.skywayFlights = this;
    this.version = 0;
    this.poll();
    this.follow();
  },
  unmounted() {
    clearTimeout(this.timer);
    this.gone = true;
  },
  methods: {
    async poll() {
      clearTimeout(this.timer);
      const begun = performance.now();
      try {
        const [digest] = await Promise.all([this.fetched("/api/fleet"), this.look()]);
        this.digest = markRaw(digest); // hundreds of rows: nobody watches each
        this.lost = false;
        this.draw();
      } catch {
        this.lost = true;
      }
      const wait = document.hidden ? 5 * EVERY_MS : Math.max(100, EVERY_MS - (performance.now() - begun));
      clearTimeout(this.timer);
      if (!this.gone) this.timer = setTimeout(() => this.poll(), wait);
    },
    // Between two digests: where vehicles have moved to, as soon as it is known.
    async follow() {
      while (!this.gone) {
        try {
          if (document.hidden || !this.digest.vehicles.length) await new Promise((done) => setTimeout(done, EVERY_MS));
          else this.move(await this.fetched(`/api/positions?since=${this.version}`));
        } catch {
          await new Promise((done) => setTimeout(done, EVERY_MS));
        }
      }
    },
    move({ version, rows }) {
      this.version = version;
      const places = new Map(rows.map(([key, lat, lon]) => [key, [lat, lon]]));
      for (const one of this.digest.vehicles) {
        const place = places.get(keyOf(one));
        if (place) [one.lat, one.lon] = place;
      }
      const map = window.skywayMap;
      if (!map || !rows.length) return;
      for (const one of map.state.vehicles) {
        const place = places.get(one.id);
        if (place && place[0] !== null) {
          turn(one, place);
          [one.lat, one.lon] = place;
        }
      }
      map.changed();
    },
    async fetched(address) {
      const answer = await fetch(address, { signal: AbortSignal.timeout(LONG_MS) });
      if (!answer.ok) throw new Error(answer.statusText);
      return answer.json();
    },
    // What is new of the flight that is open.
    async look() {
      const name = this.open_;
      if (!name) return;
      const before = this.flight?.name === name ? this.flight : null;
      const answer = await fetch(`/api/flight?name=${encodeURIComponent(name)}&seen=${before?.last || 0}`, { signal: AbortSignal.timeout(LONG_MS) });
      if (answer.status === 404) {
        if (before) this.open_ = "";
        return;
      }
      const told = await answer.json();
      if (this.open_ !== name) return;
      if (before) {
        told.rows = [...before.rows, ...told.rows].slice(-KEPT_ROWS);
        told.points = [...before.points, ...told.points].slice(-KEPT_ROWS);
      }
      this.flight = Object.freeze(told);
      for (const one of this.asked) {
        const rows = told.rows.filter((row) => row.event === "order" && row.id === one.id);
        if (!rows.length) continue;
        one.told = rows.map((row) => row.text).join("; ");
        one.wrong = rows.some((row) => row.done === "refused" || row.done === "failed");
        one.answered = true;
      }
    },
    draw() {
      const { vehicles, flights, deliveries } = this.digest;
      const flown = flights
        .filter((one) => one.vehicle.lat !== null && one.vehicle.lat !== undefined && !one.ended)
        .map((one) => ({ id: one.name, name: `drone ${one.vehicle.system} to ${one.to || one.destination}`, lat: one.vehicle.lat, lon: one.vehicle.lon, heading_deg: one.vehicle.course_deg ?? 0, stale: one.silent || one.vehicle.silent_s > 5 }));
      const tracks = deliveries.map((one) => ({ points: one.track, colour: "vehicle", width: 2 }));
      for (const one of flights) {
        const chosen = one.name === this.open_;
        if (one.ended && !chosen) continue;
        tracks.push({ points: one.way, colour: "route", width: chosen ? 4 : 2, dash: [8, 6] });
        tracks.push({ points: one.track, colour: "vehicle", width: chosen ? 3 : 2 });
      }
      const shown = flights.find((one) => one.name === this.open_);
      const live = this.flight && this.flight.name === this.open_ ? this.flight.live : null;
      const refuges = (live?.offered || []).filter((word) => word.startsWith("divert ")).map((word) => word.slice(7));
      const marks = (live?.refuges || []).map((one) => ({ station: one.station, minutes: Math.round(one.left_s / 60), soc: one.soc_land, risk: one.p_below_reserve }));
      const parts = { vehicles: [...onMap(vehicles, this.courses), ...flown], tracks, refuges, reach: marks };
      const wind = live?.wind.measured || live?.wind.expected;
      const { lat, lon } = live?.vehicle || {};
      parts.wind = wind && lat !== null && lat !== undefined && !live.ended ? { points: [[lat, lon]], hours: [{ east: [wind.east_mps], north: [wind.north_mps] }] } : null;
      const framed = shown && `${shown.name} ${shown.to}`;
      if (shown && this.framed !== framed && shown.way.length) {
        this.framed = framed;
        const [lats, lons] = [shown.way.map((p) => p[0]), shown.way.map((p) => p[1])];
        Object.assign(parts, { bounds: [Math.min(...lons) - AROUND, Math.min(...lats) - AROUND, Math.max(...lons) + AROUND, Math.max(...lats) + AROUND], fitted: true });
      }
      window.skywayMap?.set(parts);
    },
    open(name, takes) {
      this.choose(name);
      if (takes) this.takes = name;
    },
    choose(name) {
      if (name && !this.digest.flights.some((one) => one.name === name) && name.includes(" ")) return;
      this.open_ = name;
      this.flight = null;
      this.asked = [];
      this.wanted = "";
      this.charged = null;
      this.framed = "";
      const address = new URL(location.href);
      if (name) address.searchParams.set("flight", name);
      else address.searchParams.delete("flight");
      history.replaceState(history.state, "", address);
      this.poll();
    },
    prepare(word) {
      this.wanted = word;
      this.$nextTick(() => document.getElementById("divert-to")?.scrollIntoView({ block: "nearest" }));
    },
    // Ask for something once: with an id of its own, so that it may be sent again where the answer was lost.
    async order(word) {
      const { live, name } = this.flight;
      const asked = { id: newId(), word, told: "asked", wrong: false, answered: false };
      this.asked.push(asked);
      const one = this.asked.at(-1);
      const answers = live.question_n !== null && live.answers.includes(word);
      const body = JSON.stringify({ flight: name, id: asked.id, word, name: this.name, about: answers ? live.question_n : null });
      for (let tries = 0; tries < 5; tries++) {
        try {
          const answer = await fetch("/api/order", { method: "POST", body, headers: { "Content-Type": "application/json" }, signal: AbortSignal.timeout(LONG_MS) });
          if (answer.ok) {
            if (!one.answered) one.told = "sent: the flight has not answered yet";
            return this.poll();
          }
          one.told = (await answer.json()).error;
          one.wrong = true;
          return null;
        } catch {
          one.told = "the page's server does not answer: asking again";
          await new Promise((done) => setTimeout(done, 800));
        }
      }
      one.told = "not sent: the page's server does not answer";
      one.wrong = true;
      return null;
    },
    called(name) {
      this.name = name.slice(0, 40);
      localStorage.setItem("skyway-name", this.name);
    },
    tabs() {
      const { flights } = this.digest;
      const tab = (name, words, alarm) =>
        h("button", { key: name, type: "button", role: "tab", "aria-selected": String(this.open_ === name), class: ["tab", alarm ? "warn" : ""], onClick: () => this.choose(name) }, alarm ? `! ${words}` : words);
      const wrong = (one) => one.silent || one.problem || ["lost-link", "holding", "crashed", "landed-elsewhere"].includes(one.state);
      return h("div", { class: "tabs", role: "tablist", "aria-label": "Flights" }, [
        tab("", "All", false),
        ...flights.map((one) => tab(one.name, `${one.origin ? `${one.origin} > ${one.destination}` : one.name}, ${one.question && !one.ended ? "asks" : one.state}`, wrong(one))),
      ]);
    },
    all() {
      const { watches, deliveries, vehicles, flights } = this.digest;
      const under = flights.filter((one) => !one.ended).length;
      return h("div", { class: "fleet" }, [
        h("p", { class: "status", role: "status" }, `${under} ${under === 1 ? "flight" : "flights"} under way, ${vehicles.length} vehicles heard`),
        watches.filter((one) => one.ended).map((one) => h("p", { class: "warn" }, `${one.connection}: ended. ${one.said}`)),
        flights.length ? null : h("p", { class: "faint" }, "No flight yet: choose a plan and a connection under Depart, or fly the demonstration."),
        vehicleTable(vehicles, this),
        deliveries.length ? h("h2", "Flown from terminals") : null,
        deliveries.map((one) =>
          h("section", { key: one.file }, [
            h("p", [h("b", one.state), ` ${one.reason} `, h("a", { href: `/replay?log=${encodeURIComponent(one.file)}` }, one.file)]),
            h("pre", { class: "output" }, inWords(one.lines.join("\n"), this)),
          ]),
        ),
      ]);
    },
    me() {
      return h("div", { class: "line me" }, [
        h("label", { for: "my-name" }, "Your name, for the journal"),
        h("input", { id: "my-name", type: "text", maxlength: 40, value: this.name, autocomplete: "off", onInput: (e) => this.called(e.target.value) }),
      ]);
    },
  },
  watch: {
    flight(told) {
      if (told && this.takes === told.name && told.live.holder === null && told.live.time_s !== null) {
        this.takes = "";
        this.order("take");
      }
      document.title = told && !told.live.ended && alarms(told).length ? "! skyway: fly" : "skyway: fly";
    },
  },
  render() {
    const told = this.open_ && this.flight?.name === this.open_ ? this.flight : null;
    return h("div", { class: "flights" }, [
      h("p", { class: this.lost ? "status wrong" : "only-heard", role: "status" }, this.lost ? "The page's server does not answer: the data shown are old. Flights go on." : ""),
      this.tabs(),
      told ? [flightView(this), this.me()] : this.open_ ? h("p", { class: "status" }, "The flight starts …") : this.all(),
    ]);
  },
};

// Vehicles that are heard: one digest a second for the map and the table; nothing of it goes through the page's own connection.
import { h } from "vue";

const ROWS = 60;

export default {
  props: { speedUnit: String, speedFactor: Number, heightUnit: String, heightFactor: Number },
  data() {
    return { digest: { vehicles: [], watches: [], deliveries: [] }, lost: false, sought: "" };
  },
  mounted() {
    this.poll();
  },
  unmounted() {
    clearTimeout(this.timer);
    this.gone = true;
  },
  methods: {
    async poll() {
      try {
        const answer = await fetch("/api/fleet");
        if (!answer.ok) throw new Error(answer.statusText);
        this.take(await answer.json());
        this.lost = false;
      } catch {
        this.lost = true;
      }
      if (!this.gone) this.timer = setTimeout(() => this.poll(), document.hidden ? 5000 : 1000);
    },
    take(digest) {
      this.digest = Object.freeze(digest);
      const vehicles = digest.vehicles
        .filter((one) => one.lat !== null && one.lon !== null)
        .map((one) => ({ id: this.key(one), name: String(one.system), lat: one.lat, lon: one.lon, heading_deg: this.heading(one), stale: one.age_s + one.silent_s > 5 }));
      const tracks = digest.deliveries.map((one) => ({ points: one.track, colour: "vehicle", width: 2 }));
      window.skywayMap?.set({ vehicles, tracks });
    },
    key(one) {
      return `${one.connection} ${one.system}`;
    },
    // Where it moved since the digest before; vehicles do not tell their course in a watch.
    heading(one) {
      this.before ||= new Map();
      const known = this.before.get(this.key(one));
      let course = known?.course ?? 0;
      if (known && (known.lat !== one.lat || known.lon !== one.lon)) {
        const east = (one.lon - known.lon) * Math.cos((one.lat * Math.PI) / 180);
        course = ((Math.atan2(east, one.lat - known.lat) * 180) / Math.PI + 360) % 360;
      }
      this.before.set(this.key(one), { lat: one.lat, lon: one.lon, course });
      return course;
    },
    value(x, factor, unit, digits = 0) {
      return x === null || x === undefined ? "unknown" : `${(x * factor).toFixed(digits)} ${unit}`;
    },
    row(one) {
      const silent = one.age_s + one.silent_s > 5;
      const show = () => one.lat !== null && window.skywayMap?.set({ centre: [one.lat, one.lon] });
      const cells = [
        h("td", h("button", { type: "button", class: "plain", onClick: show }, `${one.system} ${one.autopilot}`)),
        h("td", `${one.mode}${one.armed ? ", armed" : ""}`),
        h("td", { class: "n" }, this.value(one.height_m, this.heightFactor, this.heightUnit)),
        h("td", { class: "n" }, this.value(one.ground_speed_mps, this.speedFactor, this.speedUnit, 1)),
        h("td", { class: "n" }, this.value(one.soc, 100, "%")),
        h("td", one.wind_mps === null ? "unknown" : `${this.value(one.wind_mps, this.speedFactor, this.speedUnit, 1)} from ${one.wind_from_deg}°`),
        h("td", one.item === null ? one.mission : `item ${one.item} ${one.mission}`),
        h("td", { class: silent ? "warn" : "" }, silent ? `silent for ${Math.round(one.age_s + one.silent_s)} s` : `${Math.round(100 * (1 - one.loss))} %`),
        h("td", { class: one.doubts.length ? "warn" : "" }, one.doubts.join("; ")),
      ];
      return h("tr", { key: this.key(one) }, cells);
    },
    table() {
      const words = this.sought.toLowerCase();
      const found = this.digest.vehicles.filter((one) => !words || JSON.stringify(one).toLowerCase().includes(words));
      if (!found.length) return h("p", { class: "faint" }, "No vehicle is heard. Name a connection and press Watch.");
      const names = ["vehicle", "mode", "height", "speed", "charge", "wind", "mission", "link", "doubts"];
      const head = h("tr", names.map((name) => h("th", { class: ["height", "speed", "charge"].includes(name) ? "n" : "" }, name)));
      const more = found.length > ROWS ? h("p", { class: "faint" }, `${found.length - ROWS} more: search to narrow them`) : null;
      return [h("div", { class: "scroll" }, h("table", [h("thead", head), h("tbody", found.slice(0, ROWS).map((one) => this.row(one)))])), more];
    },
  },
  render() {
    const { watches, deliveries, vehicles } = this.digest;
    return h("div", { class: "fleet" }, [
      h("p", { class: this.lost ? "status wrong" : "status", role: "status" }, this.lost ? "The page's server does not answer: what is shown is old." : `${vehicles.length} vehicles heard`),
      watches.filter((one) => one.ended).map((one) => h("p", { class: "warn" }, `${one.connection}: ended. ${one.said}`)),
      vehicles.length > 8
        ? h("div", { class: "field" }, [
            h("label", { for: "fleet-search" }, "Search"),
            h("input", { id: "fleet-search", type: "search", value: this.sought, onInput: (e) => (this.sought = e.target.value) }),
          ])
        : null,
      this.table(),
      deliveries.length ? h("h2", "Deliveries under way") : null,
      deliveries.map((one) =>
        h("section", { key: one.file }, [
          h("p", [h("b", one.state), ` ${one.reason} `, h("a", { href: `/replay?log=${encodeURIComponent(one.file)}` }, one.file)]),
          h("pre", { class: "output" }, one.lines.join("\n")),
        ]),
      ),
    ]);
  },
};

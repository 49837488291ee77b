// The map as a component of NiceGUI: it hands data in and events out, and draws nothing itself.
import { h } from "vue";
import { SkywayMap } from "skyway-map";

const EVERYWHERE = ["region", "base", "outline", "ground"];

export default {
  props: { label: String },
  render() {
    return h("div", { class: "map" });
  },
  mounted() {
    this.map = new SkywayMap(this.$el, this.label, (name, detail) => this.$emit(name, detail));
    window.skywayMap = this.map; // for tests and for the page's own scripts
    for (const name of EVERYWHERE) this.load(name, `/api/${name}`);
  },
  unmounted() {
    this.map.destroy();
    if (window.skywayMap === this.map) window.skywayMap = undefined;
  },
  methods: {
    set(parts) {
      this.map.set(parts);
    },
    load(name, url) {
      this.map.load(name, url);
    },
    fit() {
      this.map.fit();
    },
  },
};

// How a fleet stands: one document every two seconds, whose parts are shown where they have changed.
import { h } from "vue";

const EVERY_MS = 2000;
const LONG_MS = 90000;

export default {
  props: { ledger: String, holder: String, parts: Array },
  emits: ["failed"],
  mounted() {
    this.shown = {};
    this.poll();
  },
  unmounted() {
    this.gone = true;
    clearTimeout(this.timer);
  },
  watch: {
    ledger() {
      this.poll();
    },
    holder() {
      this.poll();
    },
  },
  methods: {
    async poll() {
      clearTimeout(this.timer);
      const asked = `${this.ledger} ${this.holder}`;
      if (this.ledger) {
        const problem = await this.read(asked);
        if (this.gone || asked !== `${this.ledger} ${this.holder}`) return;
        if (problem !== this.problem) this.$emit("failed", problem);
        this.problem = problem;
      } else this.show({}, []);
      if (!this.gone) this.timer = setTimeout(() => this.poll(), document.hidden ? 5 * EVERY_MS : EVERY_MS);
    },
    // What went wrong, in words; nothing where it was read.
    async read(asked) {
      try {
        const query = new URLSearchParams({ ledger: this.ledger, holder: this.holder });
        const answer = await fetch(`/api/dispatch?${query}`, { signal: AbortSignal.timeout(LONG_MS) });
        const told = await answer.json();
        if (this.gone || asked !== `${this.ledger} ${this.holder}`) return "";
        if (!answer.ok) return told.error;
        this.show(told.parts, told.vehicles);
        return "";
      } catch {
        return "The page's server does not answer: the data shown are old.";
      }
    },
    show(parts, vehicles) {
      for (const name of this.parts) {
        const words = parts[name] || "";
        if (this.shown[name] === words) continue;
        this.shown[name] = words;
        this.$refs[name].setHTML(words); // cleaned, as everywhere
      }
      window.skywayMap?.set({ vehicles });
    },
  },
  render() {
    return h("div", { class: "fleet" }, this.parts.map((name) => h("div", { ref: name, key: name, role: name === "alarms" ? "status" : undefined })));
  },
};

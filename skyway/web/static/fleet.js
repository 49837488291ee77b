// How a fleet stands: one document every two seconds, whose parts are shown where they have changed; and orders that a person cancels.
import { h } from "vue";
import Hold from "skyway-flight/hold.js";

const EVERY_MS = 2000;
const SLOW_MS = 10000;
const LONG_MS = 90000;
const OLD = "The page's server does not answer: the data shown are old.";
const SLOW = `No answer for ${SLOW_MS / 1000} s: the data shown are old.`;

export default {
  props: { ledger: String, holder: String, parts: Array },
  data() {
    return { problem: "", cancellable: [], wanted: "", asking: false, answer: "", wrong: false, name: localStorage.getItem("skyway-name") || "" };
  },
  mounted() {
    this.shown = {};
    this.vehicles = [];
    this.poll();
  },
  unmounted() {
    this.gone = true;
    clearTimeout(this.timer);
  },
  watch: {
    ledger() {
      this.another();
    },
    holder() {
      this.another();
    },
  },
  methods: {
    // Nothing of one fleet is shown under the name of another.
    another() {
      this.show({ parts: {}, vehicles: [], cancellable: [] });
      [this.problem, this.wanted, this.answer] = ["", "", ""];
      this.poll();
    },
    async poll() {
      clearTimeout(this.timer);
      const asked = `${this.ledger} ${this.holder}`;
      if (this.ledger) {
        const slow = setTimeout(() => asked === `${this.ledger} ${this.holder}` && this.tell(SLOW), SLOW_MS);
        const problem = await this.read(asked);
        clearTimeout(slow);
        if (this.gone || asked !== `${this.ledger} ${this.holder}`) return;
        this.tell(problem);
      }
      if (!this.gone) this.timer = setTimeout(() => this.poll(), document.hidden ? 5 * EVERY_MS : EVERY_MS);
    },
    // What went wrong, in words; nothing where it was read.
    async read(asked) {
      try {
        const query = new URLSearchParams({ ledger: this.ledger, holder: this.holder });
        const answer = await fetch(`/api/dispatch?${query}`, { signal: AbortSignal.timeout(LONG_MS) });
        const told = await answer.json();
        if (this.gone || asked !== `${this.ledger} ${this.holder}`) return "";
        if (!answer.ok) return Object.values(this.shown).some(Boolean) ? `${told.error}; the data shown are old` : told.error;
        this.show(told);
        return "";
      } catch {
        return OLD;
      }
    },
    tell(problem) {
      this.problem = problem;
      if (problem) window.skywayMap?.set({ vehicles: this.vehicles.map((one) => ({ ...one, stale: true })) });
    },
    show({ parts, vehicles, cancellable }) {
      for (const name of this.parts) {
        const words = parts[name] || "";
        if ((this.shown[name] || "") === words) continue;
        this.shown[name] = words;
        this.$refs[name].setHTML(words); // cleaned, as everywhere
      }
      this.vehicles = vehicles;
      window.skywayMap?.set({ vehicles });
      if (JSON.stringify(cancellable) !== JSON.stringify(this.cancellable)) this.cancellable = cancellable;
      if (!this.wanted || this.asking || cancellable.some((one) => one.id === this.wanted)) return;
      this.say(`${this.wanted} can no longer be cancelled: the table of orders shows its state.`, true);
      this.wanted = ""; // never another order in its place
    },
    say(words, wrong) {
      this.answer = words;
      this.wrong = wrong;
    },
    async cancel(order) {
      if (this.asking || order !== this.wanted) return;
      const { ledger, holder, name } = this;
      this.asking = true;
      this.say(`${order}: asking …`, false);
      let [words, wrong] = ["", true];
      try {
        const body = JSON.stringify({ ledger, holder, order, name });
        const answer = await fetch("/api/dispatch/cancel", { method: "POST", body, headers: { "Content-Type": "application/json" }, signal: AbortSignal.timeout(LONG_MS) });
        const told = await answer.json();
        [words, wrong] = answer.ok ? [told.told, false] : [told.error, true];
      } catch {
        words = `${order}: the page's server does not answer; whether the cancellation was asked for is not known. The table of orders will show it.`;
      }
      this.asking = false;
      if (ledger !== this.ledger || holder !== this.holder) return;
      this.wanted = "";
      this.say(words, wrong);
      this.poll();
    },
    called(name) {
      this.name = name.slice(0, 40);
      localStorage.setItem("skyway-name", this.name);
    },
    cancelling() {
      const { cancellable, wanted, asking } = this;
      const options = [h("option", { value: "" }, "choose an order"), ...cancellable.map((one) => h("option", { key: one.id, value: one.id }, one.words))];
      const line = h("div", { class: "line" }, [
        h("label", { for: "cancel-order" }, "Order"),
        h("select", { id: "cancel-order", value: wanted, disabled: asking, onChange: (e) => ([this.wanted, this.answer] = [e.target.value, ""]) }, options),
        h("label", { for: "my-name" }, "Your name, for the records"),
        h("input", { id: "my-name", type: "text", maxlength: 40, value: this.name, autocomplete: "off", onInput: (e) => this.called(e.target.value) }),
        h(Hold, { key: wanted, words: wanted ? `Cancel ${wanted}` : "Cancel the order", kind: "grave", disabled: !wanted, onHeld: () => this.cancel(wanted) }),
      ]);
      const note = "Only orders whose package is in no drone are listed. A drone that flies to the package stays where it stands or lands next, and is then free.";
      return h("section", { key: "cancelling", class: "cancelling", "aria-label": "Cancel an order" }, [
        cancellable.length ? [h("h2", "Cancel an order"), line, h("p", { class: "faint" }, note)] : null,
        h("p", { class: this.wrong ? "status wrong" : "status", role: "status" }, this.answer),
      ]);
    },
  },
  render() {
    const parts = this.parts.map((name) => h("div", { ref: name, key: name, role: name === "alarms" ? "status" : undefined }));
    parts.splice(this.parts.indexOf("orders"), 0, this.cancelling());
    return h("div", { class: "fleet" }, [h("p", { key: "problem", class: this.problem ? "status wrong" : "only-heard", role: "status" }, this.problem), ...parts]);
  },
};

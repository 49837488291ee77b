// A labelled control of a form. What a person is typing is theirs: the server's value is taken only when it changes.
import { h } from "vue";

export default {
  props: {
    label: String,
    kind: { type: String, default: "text" },
    value: { type: [String, Number, Boolean], default: "" },
    options: { type: Array, default: () => [] },
    hint: String,
    error: String,
    unit: String,
    extra: { type: Object, default: () => ({}) },
  },
  emits: ["change", "slide"],
  data() {
    return { shown: this.value };
  },
  watch: {
    value(next) {
      this.shown = next;
    },
  },
  render() {
    const id = `${this.$attrs.id}-in`;
    const told = [this.error && `${id}-error`, this.hint && `${id}-hint`].filter(Boolean).join(" ");
    const common = {
      id,
      "aria-describedby": told || undefined,
      "aria-invalid": this.error ? "true" : undefined,
      onChange: (e) => this.changed(e),
      ...this.extra,
    };
    return h("div", { class: ["field", `field-${this.kind}`, this.error && "wrong"] }, [
      h("label", { for: id }, this.unit ? [this.label, h("span", { class: "unit" }, ` ${this.unit}`)] : this.label),
      this.control(id, common),
      this.hint ? h("div", { id: `${id}-hint`, class: "hint" }, this.hint) : null,
      this.error ? h("div", { id: `${id}-error`, class: "error", role: "alert" }, this.error) : null,
    ]);
  },
  methods: {
    control(id, common) {
      if (this.kind === "select") {
        const choices = this.options.map(([value, words]) => h("option", { value, selected: value === this.shown }, words));
        return h("select", { ...common, value: this.shown }, choices);
      }
      if (this.kind === "check") return h("input", { ...common, type: "checkbox", checked: Boolean(this.shown) });
      if (this.kind === "area") return h("textarea", { ...common, value: this.shown, onInput: (e) => (this.shown = e.target.value) });
      const typed = { ...common, value: this.shown, onInput: (e) => this.typing(e) };
      if (this.kind === "range") return h("input", { ...typed, type: "range" });
      if (this.kind !== "listed") return h("input", { ...typed, type: this.kind, autocomplete: "off", spellcheck: "false" });
      const list = h("datalist", { id: `${id}-list` }, this.options.map(([value, words]) => h("option", { value }, words)));
      return [h("input", { ...typed, type: "text", list: `${id}-list`, autocomplete: "off", spellcheck: "false" }), list];
    },
    typing(e) {
      this.shown = e.target.value;
      if (this.kind === "range") this.$emit("slide", e.target.value);
    },
    changed(e) {
      const value = this.kind === "check" ? e.target.checked : e.target.value;
      this.shown = value;
      this.$emit("change", value);
    },
  },
};

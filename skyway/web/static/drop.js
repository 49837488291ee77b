// A place for files: dropped or chosen, they go to the work folder under a name that is free.
import { h } from "vue";

export default {
  props: { label: String, accept: String },
  emits: ["uploaded", "refused"],
  data() {
    return { over: false, busy: "" };
  },
  render() {
    const id = `${this.$attrs.id}-in`;
    const take = (e) => {
      e.preventDefault();
      this.over = false;
      this.send([...(e.dataTransfer?.files || e.target.files || [])]);
    };
    return h(
      "div",
      {
        class: ["drop", this.over && "over"],
        onDragover: (e) => (e.preventDefault(), (this.over = true)),
        onDragleave: () => (this.over = false),
        onDrop: take,
      },
      [
        h("label", { for: id }, this.label),
        h("input", { id, type: "file", multiple: true, accept: this.accept, onChange: take }),
        h("div", { class: "hint", role: "status" }, this.busy),
      ],
    );
  },
  methods: {
    async send(files) {
      for (const file of files) {
        this.busy = `${file.name} …`;
        try {
          const answer = await fetch(`/api/upload?name=${encodeURIComponent(file.name)}`, { method: "POST", body: file });
          const told = await answer.json().catch(() => ({ error: answer.statusText }));
          if (answer.ok) this.$emit("uploaded", told.name);
          else this.$emit("refused", `${file.name}: ${told.error || told.detail}`);
        } catch {
          this.$emit("refused", `${file.name}: too large, or the connection was lost`);
        }
      }
      this.busy = "";
    },
  },
};

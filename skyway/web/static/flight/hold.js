// A button that is held: what cannot be taken back is not done by a slip of the finger. Keys hold it, too; who cannot hold presses it twice.
import { h } from "vue";

const HOLD_MS = 1100;
const AGAIN_MS = 5000;

export default {
  props: { words: String, kind: String, disabled: Boolean, told: String },
  emits: ["held"],
  data() {
    return { share: 0, asked: false, slipped: false };
  },
  unmounted() {
    clearTimeout(this.timer);
    this.begun = 0;
    this.release();
  },
  methods: {
    press() {
      if (this.disabled || this.begun) return;
      this.begun = performance.now();
      const step = (now) => {
        if (!this.begun) return;
        this.share = Math.min(1, (now - this.begun) / HOLD_MS);
        if (this.share < 1) this.frame = requestAnimationFrame(step);
        else this.done();
      };
      this.frame = requestAnimationFrame(step);
    },
    release() {
      cancelAnimationFrame(this.frame);
      if (this.begun) this.tellHow();
      this.begun = 0;
      this.share = 0;
    },
    // Who only clicks it is told to hold it.
    tellHow() {
      this.slipped = true;
      clearTimeout(this.timer);
      this.timer = setTimeout(() => (this.slipped = false), AGAIN_MS);
    },
    done() {
      this.begun = 0;
      this.slipped = false;
      this.release();
      this.asked = false;
      this.$emit("held");
    },
    // A click without a press comes from a screen reader or another aid.
    click(e) {
      if (e.detail !== 0 || this.disabled || this.keyed) return;
      if (this.asked) this.done();
      else {
        this.asked = true;
        setTimeout(() => (this.asked = false), AGAIN_MS);
      }
    },
    key(e, down) {
      if (e.key !== " " && e.key !== "Enter") return;
      e.preventDefault();
      this.keyed = down;
      if (down && !e.repeat) this.press();
      if (!down) this.release();
    },
  },
  render() {
    const words = this.asked ? `Press again: ${this.words}` : this.slipped ? `Hold it down: ${this.words}` : this.words;
    return h(
      "button",
      {
        type: "button", class: ["hold", this.kind], disabled: this.disabled, title: this.told ? `${this.told}. Hold it down for a second` : "Hold it down for a second", style: { "--held": this.share },
        onPointerdown: (e) => e.button === 0 && this.press(), onPointerup: () => this.release(), onPointerleave: () => this.release(),
        onPointercancel: () => this.release(), onKeydown: (e) => this.key(e, true), onKeyup: (e) => this.key(e, false), onBlur: () => this.release(),
        onClick: (e) => this.click(e), onContextmenu: (e) => e.preventDefault(),
      },
      [h("span", words), h("span", { class: "only-heard" }, " (hold for a second)")],
    );
  },
};

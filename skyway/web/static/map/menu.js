// A small menu at a place of the map: buttons, by mouse and by keyboard.

export class Menu {
  constructor(root, choose) {
    this.root = root;
    this.choose = choose;
    this.box = document.createElement("div");
    this.box.className = "map-menu";
    this.box.setAttribute("role", "menu");
    this.box.setAttribute("aria-label", "At this place");
    this.box.hidden = true;
    this.box.addEventListener("keydown", (e) => this.key(e));
    root.append(this.box);
  }

  open(x, y, title, actions, target) {
    this.box.replaceChildren();
    const head = document.createElement("div");
    head.className = "map-menu-title";
    head.setAttribute("role", "presentation");
    head.textContent = title || `${target.lat.toFixed(5)}, ${target.lon.toFixed(5)}`;
    this.box.append(head);
    for (const action of actions) {
      const button = document.createElement("button");
      button.type = "button";
      button.setAttribute("role", "menuitem");
      button.textContent = action.words;
      button.addEventListener("click", () => {
        if (this.box.contains(document.activeElement)) this.root.querySelector("canvas").focus({ preventScroll: true });
        this.close();
        this.choose(action.name, target);
      });
      this.box.append(button);
    }
    this.box.hidden = false;
    const { clientWidth, clientHeight } = this.root;
    this.box.style.left = `${Math.max(4, Math.min(x + 8, clientWidth - this.box.offsetWidth - 4))}px`;
    this.box.style.top = `${Math.max(4, Math.min(y + 8, clientHeight - this.box.offsetHeight - 4))}px`;
  }

  focus() {
    this.box.querySelector("button")?.focus();
  }

  close() {
    this.box.hidden = true;
  }

  key(e) {
    const buttons = [...this.box.querySelectorAll("button")];
    const at = buttons.indexOf(document.activeElement);
    if (e.key === "Escape") {
      this.close();
      this.root.querySelector("canvas").focus();
    } else if (e.key === "ArrowDown") buttons[(at + 1) % buttons.length]?.focus();
    else if (e.key === "ArrowUp") buttons[(at - 1 + buttons.length) % buttons.length]?.focus();
    else return;
    e.preventDefault();
    e.stopPropagation();
  }
}

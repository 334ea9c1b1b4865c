// The keyboard, the theme, print, and the help that tells of them.

const KEYS = [
  ["Space", "play, pause"],
  ["← →", "a step back, forward (Shift: ten)"],
  ["Home End", "to the start, to the end"],
  ["[ ]", "look ahead less, more"],
  ["j k", "next pair, the one before"],
  ["+ − f", "zoom in, out, fit"],
  ["t", "light, dark, as the system"],
  ["?", "this help"],
];

function helpDialog() {
  const dialog = el(
    "dialog",
    { "aria-labelledby": "help-title" },
    el("h2", { id: "help-title" }, "Keys"),
    el(
      "table",
      null,
      el(
        "tbody",
        null,
        KEYS.map(([keys, what]) =>
          el(
            "tr",
            null,
            el(
              "th",
              { scope: "row" },
              keys.split(" ").map((key) => el("kbd", null, key)),
            ),
            el("td", null, what),
          ),
        ),
      ),
    ),
    el("button", { type: "button", onclick: () => dialog.close() }, "Close"),
  );
  document.body.append(dialog);
  return dialog;
}

const THEMES = ["system", "light", "dark"];

function setTheme(name) {
  if (name === "system") delete document.documentElement.dataset.theme;
  else document.documentElement.dataset.theme = name;
  readColours();
  state.theme = null;
  change({ theme: name });
}

function themeButton() {
  const button = el("button", {
    type: "button",
    onclick: () => setTheme(THEMES[(THEMES.indexOf(state.theme) + 1) % 3]),
  });
  const show = () => {
    replaceIn(
      button,
      el("span", { "aria-hidden": "true" }, { light: "☀", dark: "☾", system: "◐" }[state.theme]),
    );
    button.setAttribute("aria-label", `Colours: ${state.theme}`);
    button.title = `Colours: ${state.theme}`;
  };
  onChange(["theme"], show);
  show();
  return button;
}

// `page` may be filled with another document meanwhile.
function onKeys(page) {
  document.addEventListener("keydown", (event) => {
    const { target } = event;
    const { model, stage, player, help } = page;
    if (event.altKey || event.ctrlKey || event.metaKey || help.open) return;
    if (
      target.closest(
        "input:not([type=range]):not([type=checkbox]), textarea, select, [contenteditable]",
      )
    )
      return;
    const act = {
      "?": () => help.showModal(),
      t: () => setTheme(THEMES[(THEMES.indexOf(state.theme) + 1) % 3]),
      ...(model && model.decisions.length ? stepping(model, stage, player) : {}),
    }[event.key];
    const press =
      event.key === " " && target.closest("button, summary, input, a, pre, [role=region]");
    const slides = target.matches("input[type=range]") && /^(Arrow|Home|End)/.test(event.key);
    if (!act || press || slides) return;
    event.preventDefault();
    act(event);
  });
}

function stepping(model, stage, player) {
  const decision = () => model.decisions[state.index].data;
  const step = () =>
    model.episode ? model.episode.dt * model.episode.decided_every : decision().dt;
  const pairs = () => decision().pairs.map((pair) => pair.pair);
  const other = (by) => {
    const names = pairs();
    choosePair(names[(names.indexOf(state.pair) + by + names.length) % names.length]);
    say(`${state.pair}: ${model.decisions[state.index].pair(state.pair)?.status ?? ""}`);
  };
  const ahead = (by) =>
    change({
      ahead: Math.min(
        Math.max(state.ahead + by * decision().dt, 0),
        model.decisions[state.index].end,
      ),
    });
  const move = (by) => (event) => player.seek(player.now + by * step() * (event.shiftKey ? 10 : 1));
  return {
    " ": () => player.toggle(),
    ArrowRight: move(1),
    ArrowLeft: move(-1),
    Home: () => player.seek(0),
    End: () => player.seek(player.end),
    "]": () => ahead(1),
    "[": () => ahead(-1),
    j: () => other(1),
    k: () => other(-1),
    "+": () => stage.zoom(1.3),
    "=": () => stage.zoom(1.3),
    "-": () => stage.zoom(1 / 1.3),
    f: () => stage.fit(),
  };
}

// Paper is white, and all that is folded is unfolded on it.
function onPrint(page) {
  let before = null;
  const begin = () => {
    if (before) return;
    before = { theme: state.theme, folded: [...document.querySelectorAll("details:not([open])")] };
    document.documentElement.dataset.theme = "light";
    readColours();
    for (const node of before.folded) node.open = true;
    page.stage?.draw();
  };
  const done = () => {
    if (!before) return;
    for (const node of before.folded) node.open = false;
    const { theme } = before;
    before = null;
    setTheme(theme);
  };
  addEventListener("beforeprint", begin);
  addEventListener("afterprint", done);
}

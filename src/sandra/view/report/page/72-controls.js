// Below the map: what is shown, and how far in time.

const LAYERS = [
  ["sets", "Reachable set", "swatch-time"],
  ["corridor", "Only the driving corridor", "swatch-time"],
  ["occupancy", "Where others may be", "swatch-occupancy"],
  ["plan", "Plan and fail-safe", "swatch-plan"],
  ["blocking", "What is in the way", "swatch-blocking"],
  ["ids", "Ids", null],
];

function layerBoxes(model) {
  const own = model.bare ? LAYERS.filter(([name]) => name === "ids") : LAYERS;
  const layers = model.episode ? [...own, ["past", "The last second", null]] : own;
  return el(
    "fieldset",
    { class: "layers" },
    el("legend", { class: "unseen" }, "What the map shows"),
    layers.map(([name, text, swatch]) =>
      el(
        "label",
        null,
        el("input", {
          type: "checkbox",
          checked: state.layers[name],
          onchange: (event) =>
            change({ layers: { ...state.layers, [name]: event.target.checked } }),
        }),
        swatch && el("span", { class: `swatch ${swatch}`, "aria-hidden": "true" }),
        text,
      ),
    ),
  );
}

function timeKey(decision) {
  const canvas = el("canvas", { width: 120, height: 10, class: "time-key", "aria-hidden": "true" });
  const paintKey = () => {
    const c = canvas.getContext("2d");
    for (let x = 0; x < 120; x++) {
      c.fillStyle = timeColour(x / 119);
      c.fillRect(x, 0, 1, 10);
    }
  };
  onChange(["theme"], paintKey);
  requestAnimationFrame(paintKey);
  const end = decision.data.horizon * decision.data.dt;
  return el("div", { class: "key faint" }, "now", canvas, `in ${number(end)} s`);
}

function mapButtons(stage) {
  const button = (text, label, act) =>
    el("button", { type: "button", "aria-label": label, title: label, onclick: act }, text);
  return el(
    "div",
    { class: "map-buttons", role: "group", "aria-label": "Zoom" },
    button("+", "Zoom in", () => stage.zoom(1.3)),
    button("−", "Zoom out", () => stage.zoom(1 / 1.3)),
    button("⤢", "Fit the map", () => stage.fit()),
  );
}

// A slider with its name, its value in words, and where it stands in steps.
function slider({ id, text, end, step, get, set, tell }) {
  const output = el("output", { for: id });
  const input = el("input", { type: "range", id, min: 0, max: end, step, value: get() });
  input.addEventListener("input", () => set(Number(input.value)));
  const show = () => {
    input.value = get();
    output.textContent = tell(get());
    input.setAttribute("aria-valuetext", tell(get()));
  };
  return {
    node: el("div", { class: "slider" }, el("label", { for: id }, text), input, output),
    show,
    input,
  };
}

class Player {
  constructor(model) {
    this.model = model;
    this.speed = 1;
    this.button = el("button", { type: "button", class: "play", onclick: () => this.toggle() });
    this.last = null;
    onChange(["playing"], () => this.showButton());
    this.showButton();
  }

  showButton() {
    const text = state.playing ? "Pause" : "Play";
    replaceIn(
      this.button,
      el("span", { "aria-hidden": "true" }, state.playing ? "❚❚" : "▶"),
      ` ${text}`,
    );
  }

  get end() {
    return this.model.episode ? this.model.duration : this.model.decisions[state.index].end;
  }

  get now() {
    return this.model.episode ? state.time : state.ahead;
  }

  seek(time) {
    const to = Math.min(Math.max(time, 0), this.end);
    if (this.model.episode) goTo(this.model, to);
    else change({ ahead: to });
  }

  toggle() {
    if (!state.playing && this.now >= this.end - 1e-6) this.seek(0);
    if (!state.playing && this.model.episode) change({ ahead: 0 });
    change({ playing: !state.playing });
    this.last = null;
    if (!state.playing) return;
    requestAnimationFrame((now) => this.frame(now));
  }

  frame(now) {
    if (!state.playing) return;
    if (this.last !== null) this.seek(this.now + (this.speed * (now - this.last)) / 1000);
    this.last = now;
    if (this.now >= this.end - 1e-6) {
      change({ playing: false });
      return;
    }
    requestAnimationFrame((later) => this.frame(later));
  }
}

// To a time of the episode: also to the decision in force then, and to what it drives.
function goTo(model, time) {
  const index = model.at(time);
  const news = { time, index };
  if (index !== state.index) news.pair = keptPair(model.decisions[index]);
  change(news);
}

// The pair that is looked at stays, unless what was driven was looked at.
function keptPair(decision) {
  const before = state.pair;
  return state.pinned && decision.pair(before) ? before : decision.first;
}

function controls(model, stage, player) {
  const decision = () => model.decisions[state.index];
  const rows = [];
  if (model.episode) {
    const { dt } = model.episode;
    rows.push(
      slider({
        id: "time",
        text: "Time",
        end: model.duration,
        step: dt,
        get: () => state.time,
        set: (value) => {
          change({ ahead: 0 });
          goTo(model, value);
        },
        tell: (value) =>
          `${number(value, 2)} s` +
          (model.bare ? "" : `, decision ${decision().data.step + 1} of ${model.decisions.length}`),
      }),
    );
  }
  rows.push(
    slider({
      id: "ahead",
      text: "Look ahead",
      end: decision().end,
      step: decision().data.dt,
      get: () => state.ahead,
      set: (value) => change({ ahead: value }),
      tell: (value) => {
        const { dt, horizon } = decision().data;
        const step = Math.round(value / dt);
        if (value === 0) return "now";
        return (
          `+${number(value, 2)} s, ` +
          (step > horizon ? "beyond the horizon" : `step ${step} of ${horizon}`)
        );
      },
    }),
  );
  if (model.bare) rows.pop();
  const show = () => {
    if (!model.bare) rows[rows.length - 1].input.max = decision().end;
    if (model.episode) rows[0].input.max = model.duration;
    for (const row of rows) row.show();
  };
  onChange(["time", "ahead", "index", "grown"], show);
  show();
  const speed = el(
    "select",
    {
      "aria-label": "Speed of play",
      onchange: (event) => (player.speed = Number(event.target.value)),
    },
    [0.25, 0.5, 1, 2, 4].map((x) => el("option", { value: x, selected: x === 1 }, `${x}×`)),
  );
  return el(
    "div",
    { class: "controls" },
    el("div", { class: "play-row" }, player.button, speed),
    el(
      "div",
      { class: "sliders" },
      rows.map((row) => row.node),
    ),
  );
}

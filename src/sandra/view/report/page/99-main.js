// Puts the page together from the document.

function header(data, extra) {
  const head = document.getElementById("top");
  replaceIn(
    head,
    el(
      "div",
      { class: "bar-top" },
      data.home && link(data.home, "← back"),
      el("h1", null, data.title),
      el(
        "div",
        { class: "tools" },
        extra,
        themeButton(),
        el("button", { type: "button", id: "help", "aria-label": "Keys", title: "Keys (?)" }, "?"),
      ),
    ),
    data.facts.length > 0 &&
      el(
        "ul",
        { class: "chips" },
        data.facts.map(([name, value]) =>
          el("li", null, el("span", { class: "faint" }, `${name} `), value),
        ),
      ),
    data.notes.map((note) => el("p", { class: "note" }, note)),
  );
  replaceIn(
    document.getElementById("bottom"),
    el(
      "p",
      { class: "faint small" },
      `SanDRA ${data.sandra}. Sets hold every place of the ego's centre that the model can reach. Lengths are drawn to a few centimetres.`,
    ),
  );
}

// -> {model, stage, player}; the page of a decision or of an episode.
function drivePage(model, main) {
  const stage = new Stage(model);
  const player = new Player(model);
  const pairs = new Pairs(model);
  const detail = new PairDetail(model);
  const plan = el("div"),
    durations = el("div");
  const buildPlan = () => {
    replaceIn(plan, planCharts(model));
    replaceIn(durations, durationCard(model.decisions[state.index].data));
  };
  onChange(["index"], atRest(buildPlan, plan), plan);
  buildPlan();
  const caption = el("p", { class: "caption", "aria-live": "off" });
  const tell = () => {
    const { data } = model.decisions[state.index];
    const pair = model.decisions[state.index].pair(state.pair);
    const driven = data.executed.pair ? pairName(data.executed.pair) : "";
    if (data.executed.kind === "not verified")
      replaceIn(caption, el("strong", null, "Driven without a verifier"));
    else
      replaceIn(
        caption,
        el("strong", null, data.executed.pair ? `Driven: ${driven}` : "Driven: fail-safe"),
        ` (${data.operation || data.executed.kind})`,
        pair && ` · shown: the set of ${pairName(pair.pair)} `,
        pair && badge(pair.status),
      );
  };
  onChange(["index", "pair"], tell);
  tell();
  const first = model.decisions[state.index];
  const { bare } = model;
  replaceIn(
    main,
    el(
      "div",
      { class: bare ? "layout bare" : "layout" },
      el(
        "div",
        { class: "left" },
        el(
          "section",
          { class: "card map-card", "aria-label": "Map" },
          caption,
          el("div", { class: "map-holder" }, stage.canvas, mapButtons(stage)),
          el("div", { class: "under-map" }, layerBoxes(model), !bare && timeKey(first)),
          controls(model, stage, player),
        ),
        model.episode && episodeCard(model),
        !bare && [
          el(
            "section",
            { class: "card", "aria-label": "What is driven" },
            el("h2", null, "What is driven"),
            plan,
          ),
          durations,
        ],
      ),
      !bare && el("div", { class: "right" }, pairs.node, detail.node),
    ),
    !bare && textCards(model),
    !bare &&
      model.episode &&
      el(
        "section",
        { class: "card", id: "all-decisions", "aria-label": "All decisions" },
        decisionTable(model),
      ),
  );
  stage.resize();
  return { model, stage, player };
}

function evaluationPage(data, main) {
  replaceIn(
    main,
    el(
      "div",
      { class: "evaluation" },
      data.tables.map(tableCard),
      el("div", { class: "charts" }, data.charts.map(chartCard)),
    ),
  );
}

// Shows a document; what was chosen before is kept where it is still there.
function showDocument(data, keep = {}) {
  forget();
  Object.assign(
    state,
    { index: 0, ahead: 0, time: 0, playing: false, pinned: false, pair: null },
    keep,
  );
  header(data, keep.tools);
  const main = document.getElementById("main");
  const help = document.querySelector("dialog") || helpDialog();
  document.getElementById("help").addEventListener("click", () => help.showModal());
  let shown = { model: null, stage: null, player: null };
  if (data.kind === "evaluation") evaluationPage(data, main);
  else if (data.decisions.length === 0)
    replaceIn(main, el("p", { class: "card" }, "There is no decision yet."));
  else {
    const model = new Model(data);
    state.index = Math.min(state.index, model.decisions.length - 1);
    if (!model.decisions[state.index].pair(state.pair))
      state.pair = model.decisions[state.index].first;
    shown = drivePage(model, main);
  }
  return { ...shown, help };
}

// Where a link leads: #time=3.2&pair=keep,follow-lane
function fromAddress(page) {
  const wanted = new URLSearchParams(location.hash.slice(1));
  const { model } = page;
  if (!model || !model.decisions.length) return;
  const time = Number(wanted.get("time"));
  if (model.episode && Number.isFinite(time) && time > 0)
    goTo(model, Math.min(time, model.duration));
  const pair = wanted.get("pair");
  if (pair && model.decisions[state.index].pair(pair)) choosePair(pair);
}

function begin() {
  state.theme = "system";
  readColours();
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () =>
    setTheme(state.theme),
  );
  const told = JSON.parse(document.getElementById("document").textContent);
  if (told.format !== "sandra-report" || told.version !== 1) {
    replaceIn(
      document.getElementById("main"),
      el("p", { class: "card" }, "This page holds no report that it can read."),
    );
    return;
  }
  const page = typeof startLive === "function" && told.live ? startLive(told) : showDocument(told);
  onKeys(page);
  onPrint(page);
  fromAddress(page);
  globalThis.sandraPage = { page, state, change, goTo, tell };
}

begin();

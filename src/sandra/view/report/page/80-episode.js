// What happened over time: by what the ego was driven, its speed, how well rules were kept.

const OPERATIONS = {
  certified: ["✔", "a certificate of this step"],
  carried: ["↻", "the fail-safe of the last certificate"],
  renewed: ["◆", "a fail-safe made anew"],
  emergency: ["!", "the emergency layer: nothing is proven"],
  verified: ["✓", "a meta-action whose response was verified"],
};

function episodeCard(model) {
  const { episode } = model;
  const cursor = () => state.time;
  const onseek = (time) => {
    change({ ahead: 0 });
    goTo(model, time);
  };
  const end = model.duration;
  const ego = model.tracks.find((track) => track.id === episode.ego);
  const speed = ego ? ego.rows.map((row, i) => [(ego.first + i) * episode.dt, row.speed]) : [];
  const gain = ego
    ? ego.rows.slice(0, -1).map((row, i) => [(ego.first + i) * episode.dt, row.acceleration])
    : [];
  const limit = model.decisions[0]?.data.settings.speed_limit;
  return card(
    "Over time",
    { id: "timeline", class: "card wide" },
    el(
      "p",
      { class: "faint small" },
      "Click or drag in a chart to go there; arrow keys step from decision to decision.",
    ),
    model.decisions.length > 1 && operationStrip(model, onseek),
    lineChart({
      label: "Speed driven",
      unit: "m/s",
      end,
      lines: [{ points: speed, class: "ego" }],
      zero: true,
      marks: limit ? [{ value: limit, name: "speed limit", class: "limit" }] : [],
      cursor,
      onseek,
      first: false,
      height: 96,
    }),
    lineChart({
      label: "Acceleration driven",
      unit: "m/s²",
      end,
      lines: [{ points: gain, class: "ego" }],
      marks: [{ value: 0, name: "0" }],
      cursor,
      onseek,
      first: episode.rules.length === 0,
      height: 80,
    }),
    episode.rules.map((rule, i) =>
      robustnessChart(rule, end, cursor, onseek, i === episode.rules.length - 1),
    ),
    episode.told.map((text) => el("p", { class: "cause unsafe" }, text)),
  );
}

function robustnessChart(rule, end, cursor, onseek, first) {
  const points = rule.values.map((value, i) => [i * rule.dt, value]);
  const crosses = rule.broken.map((i) => points[i]);
  const word = rule.broken.length
    ? `broken at ${rule.broken.length} of ${rule.values.length} steps`
    : "kept";
  return lineChart({
    label: `${rule.name}, ${word}: robustness`,
    unit: rule.unit,
    end,
    lines: [{ points, class: rule.name, crosses: crosses, name: rule.name }],
    marks: [{ value: 0, name: "below 0 the rule is broken", class: "limit" }],
    zero: true,
    cursor,
    onseek,
    first,
    height: first ? 96 : 80,
  });
}

// One box for each decision: by what was driven, as colour and symbol.
function operationStrip(model, onseek) {
  const wide = chartWidth(),
    left = 44,
    right = 10,
    end = model.duration;
  const x = (t) => left + ((wide - left - right) * t) / Math.max(end, 1e-9);
  const boxes = model.decisions.map((decision, i) => {
    const { data } = decision;
    const next = model.decisions[i + 1]?.data.time ?? end;
    const [symbol, words] = OPERATIONS[data.operation] || ["", data.operation || ""];
    const room = x(next) - x(data.time);
    const uncovered = data.covered === false;
    return svg(
      "g",
      {
        class: `operation ${data.operation in OPERATIONS ? data.operation : ""}${room > 5 ? "" : " narrow"}`,
      },
      svg("rect", {
        x: x(data.time),
        y: 2,
        width: Math.max(room - (room > 5 ? 1 : 0), 0.5),
        height: 20,
      }),
      room > 11 &&
        svg("text", { x: x(data.time) + room / 2, y: 16, "text-anchor": "middle" }, symbol),
      uncovered &&
        svg("path", { class: "uncovered", d: `M${x(data.time)} 26h${Math.max(room - 1, 0.5)}` }),
      svg(
        "title",
        null,
        `decision ${data.step + 1}: ${data.operation}${words ? `, ${words}` : ""}${data.executed.pair ? `; ${pairName(data.executed.pair)}` : ""}${uncovered ? "; no fail-safe is known to be clear" : ""}`,
      ),
    );
  });
  const here = svg("rect", { class: "here", y: 0, height: 24, width: 3 });
  const show = () => here.setAttribute("x", x(state.time) - 1.5);
  const root = svg(
    "svg",
    {
      viewBox: `0 0 ${wide} 30`,
      class: "chart strip",
      role: "img",
      "aria-label": "By what the ego was driven, decision by decision",
    },
    boxes,
    here,
  );
  onChange(["time"], show, root);
  show();
  seekable(root, left, wide - right, wide, end, onseek);
  const used = new Set(model.decisions.map((decision) => decision.data.operation));
  const counts = [...used]
    .filter((name) => name in OPERATIONS)
    .map((name) => {
      const n = model.decisions.filter((decision) => decision.data.operation === name).length;
      return el(
        "span",
        { class: `operation-key ${name}` },
        el("span", { "aria-hidden": "true" }, OPERATIONS[name][0]),
        ` ${name} ${n}`,
      );
    });
  return el("figure", null, el("figcaption", { class: "small" }, "Driven by ", counts), root);
}

// All decisions as a table, for those who look for one.
function decisionTable(model) {
  const rows = () =>
    model.decisions.map(({ data }, i) =>
      el(
        "tr",
        { "data-index": i },
        el(
          "td",
          null,
          el(
            "button",
            { type: "button", class: "plain", onclick: () => goTo(model, data.time) },
            `${number(data.time, 1)} s`,
          ),
        ),
        el("td", null, data.operation || ""),
        el("td", null, data.executed.pair ? pairName(data.executed.pair) : "fail-safe"),
        el(
          "td",
          null,
          data.pairs
            .filter((pair) => pair.asked)
            .map((pair) => `${SYMBOLS[pair.status] || "?"} ${pair.pair}`)
            .join("  "),
        ),
        el("td", { class: "number" }, number(data.ego.speed, 1)),
      ),
    );
  const body = el("tbody");
  const mark = () => {
    for (const row of body.children)
      row.toggleAttribute("aria-current", Number(row.dataset.index) === state.index);
  };
  onChange(["index"], mark, body);
  mark();
  const node = fold(
    `All ${model.decisions.length} decisions`,
    el(
      "div",
      { class: "scroll", tabindex: "0", role: "region", "aria-label": "Decisions" },
      el(
        "table",
        null,
        el(
          "thead",
          null,
          el(
            "tr",
            null,
            ["time", "driven by", "pair", "asked of the verifier", "speed [m/s]"].map((x) =>
              el("th", { scope: "col" }, x),
            ),
          ),
        ),
        body,
      ),
    ),
  );
  // Hundreds of rows are made when they are wanted.
  const build = () => {
    if (!node.open || body.firstChild) return;
    fill(body, null, [rows()]);
    mark();
  };
  node.addEventListener("toggle", build);
  build();
  return node;
}

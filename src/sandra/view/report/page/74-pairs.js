// The pairs with their verdicts; one is chosen, and its set is on the map.

class Pairs {
  constructor(model) {
    this.model = model;
    this.list = el("div", { role: "radiogroup", "aria-label": "Action pairs", class: "pairs" });
    this.list.addEventListener("keydown", (event) => this.key(event));
    this.node = card(
      "Action pairs",
      { id: "pairs" },
      el(
        "p",
        { class: "faint small" },
        "Choose one to see its reachable set. ▶ is driven; a number is its rank.",
      ),
      this.list,
    );
    onChange(["index"], () => this.build());
    onChange(["pair"], () => this.mark());
    this.build();
  }

  get pairs() {
    return this.model.decisions[state.index].data.pairs;
  }

  build() {
    const had = this.list.contains(document.activeElement);
    replaceIn(
      this.list,
      this.pairs.map((pair) => this.row(pair)),
    );
    this.mark();
    if (had) this.list.querySelector("[aria-checked=true]")?.focus();
  }

  row(pair) {
    const when = pair.empty_step === null ? "" : `at step ${pair.empty_step}`;
    return el(
      "div",
      {
        role: "radio",
        class: `pair${pair.asked ? "" : " beside"}`,
        "data-pair": pair.pair,
        onclick: () => choosePair(pair.pair),
      },
      el(
        "span",
        { class: "rank" },
        pair.executed ? "▶ " : "",
        pair.rank === null ? "" : `${pair.rank}.`,
      ),
      el("span", { class: "pair-name" }, pairName(pair.pair)),
      badge(pair.status),
      el("span", { class: "faint small when" }, when || (pair.executed ? "driven" : "")),
    );
  }

  mark() {
    for (const row of this.list.children) {
      const chosen = row.dataset.pair === state.pair;
      row.setAttribute("aria-checked", String(chosen));
      row.tabIndex = chosen ? 0 : -1;
    }
    if (!this.list.querySelector("[tabindex='0']") && this.list.firstChild) {
      this.list.firstChild.tabIndex = 0;
    }
  }

  key(event) {
    const step = { ArrowDown: 1, ArrowRight: 1, ArrowUp: -1, ArrowLeft: -1 }[event.key];
    const ends = { Home: 0, End: this.pairs.length - 1 };
    if (step === undefined && !(event.key in ends) && event.key !== " " && event.key !== "Enter")
      return;
    event.preventDefault();
    event.stopPropagation();
    const rows = [...this.list.children];
    const here = rows.indexOf(document.activeElement);
    const to =
      event.key in ends ? ends[event.key] : (here + (step || 0) + rows.length) % rows.length;
    choosePair(this.pairs[to].pair);
    rows[to].focus();
  }
}

function choosePair(pair) {
  state.pinned = true;
  change({ pair });
}

// What there is to say about the chosen pair: verdict, cause, specification, size of its set.
class PairDetail {
  constructor(model) {
    this.model = model;
    this.node = el("section", { class: "card", id: "detail", "aria-labelledby": "detail-title" });
    onChange(["index", "pair"], () => this.build());
    this.build();
  }

  build() {
    const decision = this.model.decisions[state.index];
    const pair = decision.pair(state.pair);
    if (!pair) {
      replaceIn(this.node, el("h2", { id: "detail-title" }, "No pair was verified"));
      return;
    }
    replaceIn(
      this.node,
      el("h2", { id: "detail-title" }, pairName(pair.pair), " ", badge(pair.status)),
      el("p", { class: `cause ${pair.status.toLowerCase()}` }, cause(pair, decision.data)),
      !pair.asked &&
        el(
          "p",
          { class: "faint small" },
          "The decision did not ask for this pair; it was verified for this page alone, on the same ground.",
        ),
      el("h3", null, "What it must satisfy"),
      formula(pair, decision.data.parts),
      el("h3", null, "Size of its reachable set"),
      sizeChart(pair, decision.data),
    );
  }
}

const MEANS = {
  UNSAFE: "No trajectory of the model complies: the over-approximated set becomes empty.",
  REACHABLE: "The set lasts through the horizon: necessary for a safe trajectory, not sufficient.",
  CERTIFIED: "A trajectory with a fail-safe continuation was accepted by the independent checker.",
};

function cause(pair, decision) {
  const first = pair.reason || MEANS[pair.status] || "";
  const said = [first.charAt(0).toUpperCase() + first.slice(1)];
  if (pair.executed) said.push(`Driven: ${decision.executed.note}.`);
  return said.map((text) => (/[.)]$/.test(text) ? text : `${text}.`)).join(" ");
}

const OPERATORS = {
  G: "always: at every step until the horizon",
  F: "eventually: at some step until the horizon",
  X: "at the next step, which there must be",
  U: "until",
};

// A formula with its symbols; operators of time carry their meaning.
function symbols(text) {
  const told = text
    .replaceAll("<->", "↔")
    .replaceAll("->", "→")
    .replaceAll("<=", "≤")
    .replaceAll(">=", "≥")
    .replaceAll("&", "∧")
    .replaceAll(" | ", " ∨ ")
    .replaceAll("!", "¬");
  return told
    .split(/\b([GFXU])(?=[\s([]|$)/)
    .map((piece) => (piece in OPERATORS ? el("abbr", { title: OPERATORS[piece] }, piece) : piece));
}

function formula(pair, parts) {
  const blamed = (part) => (pair.reason || "").includes(` ${part.name} [`);
  return el(
    "ul",
    { class: "parts", "aria-label": "Specification of the pair: all of this together" },
    pair.parts
      .map((name) => parts[name])
      .filter(Boolean)
      .map((part) =>
        el(
          "li",
          { class: blamed(part) ? "blamed" : null },
          el("strong", null, part.name),
          " ",
          part.words,
          blamed(part) && el("span", { class: "unsafe-text" }, " ✗ the cause"),
          el("code", null, symbols(part.text)),
          part.values !== part.text && el("code", { class: "faint values" }, symbols(part.values)),
        ),
      ),
  );
}

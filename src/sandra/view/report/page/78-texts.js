// What was told and answered, how long what took, and what was assumed.

function textCards(model) {
  const holder = el("div", { class: "texts" });
  const build = () => {
    const data = model.decisions[state.index].data;
    replaceIn(
      holder,
      promptCard(data.prompt, model.data.texts),
      el("div", { class: "stack" }, answerCard(data.answer), settingsCard(data)),
    );
  };
  onChange(["index"], atRest(build, holder), holder);
  build();
  return holder;
}

// Open and closed stay as they are from decision to decision.
const opened = new Set(["User text"]);

function fold(title, ...children) {
  const node = el("details", { open: opened.has(title) }, el("summary", null, title), ...children);
  node.addEventListener("toggle", () => (node.open ? opened.add(title) : opened.delete(title)));
  return node;
}

function promptCard(prompt, texts) {
  const picture = /^data:image\/png;base64,[\w+/=]+$/.test(prompt.picture || "") && prompt.picture;
  return card(
    "What the ranker was told",
    { id: "prompt" },
    fold("System text", textBox(texts[prompt.system] ?? "", "System text")),
    fold("User text", textBox(prompt.user, "User text")),
    fold("Schema of the answer", textBox(texts[prompt.schema] ?? "", "Schema of the answer")),
    picture && el("img", { src: picture, alt: "The picture that the model saw", class: "seen" }),
  );
}

function answerCard(answer) {
  const who = answer.told ? `${answer.ranker} (${answer.told})` : answer.ranker;
  const raw = answer.answer ?? "";
  return card(
    "What it answered",
    { id: "answer" },
    el("p", null, el("strong", null, who), answer.cached && " – from the cache on disk"),
    answer.failure &&
      el(
        "p",
        { class: "cause unsafe" },
        `No ranking: ${answer.failure}`,
        answer.detail && ` – ${answer.detail.slice(0, 2000)}`,
      ),
    answer.ranking.length
      ? el(
          "ol",
          { class: "ranking" },
          answer.ranking.map((pair) => el("li", null, pairName(pair))),
        )
      : el("p", null, "No pair was ranked."),
    answer.warnings.map((text) => el("p", { class: "warning-text" }, text)),
    answer.reasoning && [
      el("h3", null, "Its reasons"),
      textBox(answer.reasoning, "Reasons of the ranker"),
    ],
    raw && fold("The answer, word for word", textBox(raw, "Answer of the ranker")),
    answer.usage &&
      el(
        "p",
        { class: "faint small" },
        Object.entries(answer.usage)
          .map(([k, v]) => `${k.replaceAll("_", " ")}: ${v}`)
          .join(" · "),
      ),
  );
}

function durationCard(data) {
  const stages = Object.entries(data.durations_s).filter(([name]) => name !== "total");
  const most = Math.max(...stages.map(([, s]) => s), 1e-9);
  const rows = stages.map(([name, seconds]) =>
    el(
      "tr",
      null,
      el("th", { scope: "row" }, name),
      el("td", { class: "number" }, `${number(1e3 * seconds, seconds < 0.01 ? 1 : 0)} ms`),
      el(
        "td",
        { class: "bar-cell" },
        el("span", { class: "bar", style: { width: `${(100 * seconds) / most}%` } }),
      ),
    ),
  );
  const total = data.durations_s.total;
  return card(
    "How long it took",
    { id: "durations" },
    el(
      "table",
      { class: "durations" },
      el("caption", { class: "unseen" }, "Duration of each stage"),
      el("tbody", null, rows),
    ),
    el(
      "p",
      { class: "faint small" },
      `${number(1e3 * total, 0)} ms in all. The ranker is at work while the others are predicted, so stages may add up to more.`,
    ),
  );
}

function settingsCard(data) {
  const { settings } = data;
  const rows = [
    ["command", settings.command || "none"],
    ["prediction", settings.prediction],
    ["rules", settings.rules.join(", ") || "none"],
    ["horizon", `${data.horizon} steps of ${data.dt} s`],
    ["executed if", settings.accept],
    ["mode", settings.mode],
    [
      "executed",
      `${data.executed.kind}${data.executed.pair ? ` ${pairName(data.executed.pair)}` : ""}`,
    ],
    ["how", data.executed.note],
    ...settings.notes.map((note) => ["assumed", note]),
  ];
  const dropped = data.others.filter((other) => other.dropped.length);
  for (const other of dropped.slice(0, 12))
    rows.push([`${other.kind} ${other.id} broke`, other.dropped.join(", ")]);
  return card("What it stands on", { id: "settings" }, facts(rows));
}

const facts = (rows) =>
  el(
    "dl",
    { class: "facts" },
    rows.map(([name, value]) => el("div", null, el("dt", null, name), el("dd", null, value))),
  );

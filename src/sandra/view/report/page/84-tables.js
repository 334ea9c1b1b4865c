// An evaluation: its tables, with links to episodes, and its figures.

function tableCard(table) {
  const linked = table.rows.some((row) => row.links.length);
  const headers = linked ? [...table.headers, "episodes"] : table.headers;
  return card(
    table.name,
    { class: "card wide" },
    el("p", { class: "faint small" }, table.title),
    el(
      "div",
      { class: "scroll", tabindex: "0", role: "region", "aria-label": table.name },
      el(
        "table",
        { class: "results" },
        el(
          "thead",
          null,
          el(
            "tr",
            null,
            headers.map((text) => el("th", { scope: "col" }, text)),
          ),
        ),
        el(
          "tbody",
          null,
          table.rows.map((row) =>
            el(
              "tr",
              null,
              row.cells.map((text, i) =>
                i === 0
                  ? el("th", { scope: "row" }, text)
                  : el("td", { class: /^[-+±\d]/.test(text) ? "number" : null }, text),
              ),
              linked &&
                el(
                  "td",
                  { class: "links" },
                  row.links.map((cell) => [
                    cell.href ? link(cell.href, cell.text) : cell.text,
                    " ",
                  ]),
                ),
            ),
          ),
        ),
      ),
    ),
  );
}

const PATTERNS = 6; // so many styles of bars there are in the style sheet

function chartCard(chart) {
  return card(
    chart.name,
    { class: "card wide" },
    el("p", { class: "faint small" }, chart.title),
    chart.kind === "shares" ? shareBars(chart) : intervalBars(chart),
  );
}

function keyOf(names) {
  return el(
    "p",
    { class: "chart-key small" },
    names.map((name, i) =>
      el(
        "span",
        null,
        svg(
          "svg",
          { viewBox: "0 0 14 10", class: "key-box", "aria-hidden": "true" },
          svg("rect", { class: `series-${i % PATTERNS}`, width: 14, height: 10 }),
        ),
        ` ${name}`,
      ),
    ),
  );
}

// Bars with their interval, a group for each row.
function intervalBars(chart) {
  const names = [...new Set(chart.bars.flatMap((bar) => bar.values.map((value) => value[0])))];
  const most = Math.max(
    1e-9,
    ...chart.bars.flatMap((bar) =>
      bar.values.map((value) => value[3] ?? value[1]).filter(Number.isFinite),
    ),
  );
  const end = chart.unit === "%" ? 100 : most * 1.05;
  const wide = chartWidth(720),
    left = Math.min(230, 0.38 * wide),
    high = 13;
  const x = (value) => left + ((wide - left - 46) * value) / end;
  let y = 4;
  const drawn = chart.bars.map((bar) => {
    const top = y;
    y += bar.values.length * high + 8;
    return svg(
      "g",
      null,
      svg(
        "text",
        {
          class: "tick",
          x: left - 8,
          y: top + (bar.values.length * high) / 2 + 4,
          "text-anchor": "end",
        },
        shortened(bar.name, Math.floor(left / 5.8)),
        svg("title", null, bar.name),
      ),
      bar.values.map(([name, value, low, upper], i) => {
        const at = top + i * high;
        if (!Number.isFinite(value)) return null;
        return [
          svg(
            "rect",
            {
              class: `series-${names.indexOf(name) % PATTERNS}`,
              x: left,
              y: at + 1,
              width: Math.max(x(value) - left, 0.5),
              height: high - 2,
            },
            svg("title", null, `${name}: ${number(value)} ${chart.unit}`),
          ),
          Number.isFinite(low) &&
            Number.isFinite(upper) &&
            svg("path", {
              class: "interval",
              d: `M${x(low)} ${at + high / 2}H${x(upper)}M${x(low)} ${at + 3}v${high - 6}M${x(upper)} ${at + 3}v${high - 6}`,
            }),
          svg(
            "text",
            { class: "tick", x: Math.max(x(upper ?? value), x(value)) + 4, y: at + high - 3 },
            number(value),
          ),
        ];
      }),
    );
  });
  return [
    svg(
      "svg",
      {
        viewBox: `0 0 ${wide} ${y}`,
        class: "chart bars",
        role: "img",
        "aria-label": `${chart.name} [${chart.unit}]`,
      },
      drawn,
    ),
    names.length > 1 && keyOf(names),
  ];
}

// Shares of a whole, one bar for each row.
function shareBars(chart) {
  const names = [...new Set(chart.bars.flatMap((bar) => bar.values.map((value) => value[0])))];
  const wide = chartWidth(720),
    left = Math.min(230, 0.38 * wide),
    high = 18;
  const drawn = chart.bars.map((bar, row) => {
    const whole = bar.values.reduce((sum, value) => sum + value[1], 0) || 1;
    let from = 0;
    const top = row * (high + 6) + 2;
    return svg(
      "g",
      null,
      svg(
        "text",
        { class: "tick", x: left - 8, y: top + 13, "text-anchor": "end" },
        shortened(bar.name, Math.floor(left / 5.8)),
        svg("title", null, bar.name),
      ),
      bar.values.map(([name, value]) => {
        const at = left + ((wide - left - 4) * from) / whole,
          room = ((wide - left - 4) * value) / whole;
        from += value;
        return svg(
          "g",
          null,
          svg("rect", {
            class: `series-${names.indexOf(name) % PATTERNS}`,
            x: at,
            y: top,
            width: Math.max(room - 0.8, 0),
            height: high,
          }),
          svg("title", null, `${name}: ${number((100 * value) / whole)} %`),
          room > 30 &&
            svg(
              "text",
              {
                class: `on-series-${names.indexOf(name) % PATTERNS}`,
                x: at + room / 2,
                y: top + 13,
                "text-anchor": "middle",
              },
              number((100 * value) / whole, 0),
            ),
        );
      }),
    );
  });
  return [
    svg(
      "svg",
      {
        viewBox: `0 0 ${wide} ${chart.bars.length * (high + 6) + 4}`,
        class: "chart bars",
        role: "img",
        "aria-label": `${chart.name} [${chart.unit}]`,
      },
      drawn,
    ),
    keyOf(names),
  ];
}

const shortened = (text, most) => (text.length > most ? `${text.slice(0, most - 1)}…` : text);

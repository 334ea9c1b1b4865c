// Charts as SVG: lines over time, bars, shares. Colours come from the style sheet.

function ticks(low, high, count) {
  const raw = (high - low) / Math.max(1, count);
  const power = 10 ** Math.floor(Math.log10(raw || 1));
  const step = [1, 2, 5, 10].map((x) => x * power).find((x) => x >= raw) || power;
  const found = [];
  for (let x = Math.ceil(low / step - 1e-9) * step; x <= high + 1e-9; x += step)
    found.push(Math.round(x / step) * step);
  return { step, at: found };
}

const tickText = (value, step) => value.toFixed(step >= 1 ? 0 : step >= 0.1 ? 1 : 2);

// As wide as there is room, so that letters keep their size on a phone.
const chartWidth = (most = 640) => Math.min(most, Math.max(300, innerWidth - 50));

// Lines over time. lines: [{points: [[t, y]...], class, name}]; `cursor`: a function that gives t.
function lineChart({
  label,
  unit,
  end,
  lines,
  marks = [],
  low,
  high,
  zero = false,
  cursor,
  onseek,
  height = 120,
  wide = chartWidth(),
  first = true,
}) {
  const left = 44,
    right = 10,
    top = 8,
    below = first ? 24 : 8;
  const values = lines
    .flatMap((line) => line.points.map((p) => p[1]))
    .concat(marks.map((m) => m.value))
    .filter(Number.isFinite);
  let yLow = low ?? Math.min(...values, zero ? 0 : Infinity),
    yHigh = high ?? Math.max(...values, zero ? 0 : -Infinity);
  if (!Number.isFinite(yLow) || !Number.isFinite(yHigh)) [yLow, yHigh] = [0, 1];
  const room = 0.08 * (yHigh - yLow) || 0.5;
  if (low === undefined) yLow -= room;
  if (high === undefined) yHigh += room;
  const x = (t) => left + ((wide - left - right) * t) / Math.max(end, 1e-9);
  const y = (v) => top + ((height - top - below) * (yHigh - v)) / (yHigh - yLow);
  const across = ticks(0, end, wide / 80),
    up = ticks(yLow, yHigh, height > 90 ? 4 : 2);
  const root = svg(
    "svg",
    { viewBox: `0 0 ${wide} ${height}`, class: "chart", role: "img", "aria-label": label },
    up.at.map((v) => [
      svg("line", {
        class: v === 0 ? "axis" : "grid",
        x1: left,
        x2: wide - right,
        y1: y(v),
        y2: y(v),
      }),
      svg(
        "text",
        { class: "tick", x: left - 6, y: y(v) + 3.5, "text-anchor": "end" },
        tickText(v, up.step),
      ),
    ]),
    first &&
      across.at.map((t) =>
        svg(
          "text",
          { class: "tick", x: x(t), y: height - 8, "text-anchor": "middle" },
          tickText(t, across.step) + (t === across.at[across.at.length - 1] ? " s" : ""),
        ),
      ),
    marks.map((mark) =>
      svg(
        "line",
        {
          class: `mark ${mark.class || ""}`,
          x1: left,
          x2: wide - right,
          y1: y(mark.value),
          y2: y(mark.value),
        },
        svg("title", null, mark.name),
      ),
    ),
    lines.map((line) => {
      let pen = "";
      let down = false;
      for (const [t, v] of line.points) {
        if (!Number.isFinite(v)) down = false;
        else {
          pen += `${down ? "L" : "M"}${x(t).toFixed(1)} ${y(v).toFixed(1)}`;
          down = true;
        }
      }
      return svg(
        "path",
        { class: `line ${line.class || ""}`, d: pen || "M0 0" },
        svg("title", null, line.name || label),
      );
    }),
    lines.flatMap((line) =>
      (line.crosses || [])
        .filter((p) => Number.isFinite(p[1]))
        .map(([t, v]) =>
          svg("path", { class: "cross", d: `M${x(t) - 3} ${y(v) - 3}l6 6m0 -6l-6 6` }),
        ),
    ),
  );
  if (cursor) {
    const line = svg("line", { class: "cursor", y1: top, y2: height - below });
    root.append(line);
    const show = () => {
      const t = cursor();
      line.setAttribute("x1", x(t));
      line.setAttribute("x2", x(t));
      line.style.display = t < 0 || t > end + 1e-9 ? "none" : "";
    };
    onChange(["time", "ahead", "index"], show, root);
    show();
  }
  if (onseek) seekable(root, left, wide - right, wide, end, onseek);
  return el(
    "figure",
    null,
    el("figcaption", { class: "small" }, label, unit && ` [${unitText(unit)}]`),
    root,
  );
}

// A drag or click on a chart is a time.
function seekable(root, left, right, wide, end, onseek) {
  const seek = (event) => {
    const box = root.getBoundingClientRect();
    const at = ((event.clientX - box.left) / box.width) * wide;
    onseek(Math.min(Math.max((at - left) / (right - left), 0), 1) * end);
  };
  root.classList.add("seekable");
  root.addEventListener("pointerdown", (event) => {
    root.setPointerCapture(event.pointerId);
    seek(event);
  });
  root.addEventListener("pointermove", (event) => event.buttons && seek(event));
}

function sizeChart(pair, decision) {
  const points = pair.areas.map((area, k) => [k * decision.dt, area]);
  if (pair.empty_step !== null) points.push([pair.empty_step * decision.dt, 0]);
  const chart = lineChart({
    label: "Area of the positions",
    unit: "m²",
    end: decision.horizon * decision.dt,
    lines: [
      {
        points,
        class: pair.status.toLowerCase(),
        name: pairName(pair.pair),
        crosses: pair.empty_step === null ? [] : [points[points.length - 1]],
      },
    ],
    low: 0,
    cursor: () => state.ahead,
    height: 110,
    wide: chartWidth(440),
  });
  chart.className = "size";
  return chart;
}

// Speed and acceleration of what is planned, and of the fail-safe.
function planCharts(model) {
  const decision = model.decisions[state.index];
  const data = decision.data;
  if (!decision.curves.length)
    return [el("p", { class: "faint" }, "There is no trajectory to show.")];
  const points = (curve, key, hold) => {
    const found = curve.rows.map((row, i) => [
      Math.min(curve.start + i * curve.dt, curve.end),
      row[key],
    ]);
    if (!hold) return found;
    // An acceleration is applied until the next row.
    return found.flatMap(([t, v], i) =>
      i + 1 < found.length
        ? [
            [t, v],
            [found[i + 1][0], v],
          ]
        : [],
    );
  };
  const kinds = { planned: "planned", "planned on": "planned-on", "fail-safe": "fail-safe" };
  const lines = (key, hold) =>
    decision.curves.map((curve) => ({
      points: points(curve, key, hold),
      class: kinds[curve.kind],
      name: curve.kind,
    }));
  const limit = data.settings.speed_limit;
  const common = {
    end: decision.end,
    cursor: () => state.ahead,
    onseek: (t) => change({ ahead: t }),
  };
  return [
    lineChart({
      label: "Speed of the plan",
      unit: "m/s",
      lines: lines("speed"),
      zero: true,
      marks: limit ? [{ value: limit, name: "speed limit", class: "limit" }] : [],
      ...common,
    }),
    lineChart({
      label: "Acceleration",
      unit: "m/s²",
      lines: lines("acceleration", true),
      marks: [
        { value: data.settings.a_min, name: "lowest" },
        { value: data.settings.a_max, name: "highest" },
      ],
      height: 110,
      ...common,
    }),
    el(
      "p",
      { class: "faint small" },
      el("span", { class: "stroke planned" }),
      " planned until the next decision, dashed after it; ",
      el("span", { class: "stroke fail-safe" }),
      " fail-safe, if no new decision comes",
    ),
  ];
}

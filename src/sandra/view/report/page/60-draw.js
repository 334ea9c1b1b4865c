// One picture of the road: everything is drawn from the state, nothing is remembered.

let colours = {};

function readColours() {
  const style = getComputedStyle(document.documentElement);
  colours = new Proxy(
    { time: style.getPropertyValue("--time").split(",") },
    {
      get(known, name) {
        if (!(name in known)) known[name] = style.getPropertyValue(`--${name}`).trim();
        return known[name];
      },
    },
  );
  timeCache.clear();
}

const timeCache = new Map();

// The colour of a part (0: now, 1: the horizon) of the time.
function timeColour(part) {
  const key = Math.round(Math.min(Math.max(part, 0), 1) * 100);
  if (!timeCache.has(key)) {
    const place = (key / 100) * (colours.time.length - 1);
    const low = Math.floor(place),
      high = Math.min(low + 1, colours.time.length - 1);
    const channel = (text, i) => parseInt(text.slice(1 + 2 * i, 3 + 2 * i), 16);
    const mixed = [0, 1, 2].map((i) => {
      const a = channel(colours.time[low], i),
        b = channel(colours.time[high], i);
      return Math.round(a + (place - low) * (b - a));
    });
    timeCache.set(key, `rgb(${mixed})`);
  }
  return timeCache.get(key);
}

class Painter {
  constructor(context, camera, ratio) {
    this.c = context;
    this.camera = camera;
    this.ratio = ratio;
    this.px = 1 / camera.scale; // a pixel, in metres
  }

  road(road) {
    const { c } = this;
    for (const [kind, colour] of [
      ["other", "no-cars"],
      ["lane", "lane"],
      ["current", "current-lane"],
    ]) {
      c.fillStyle = colours[colour];
      c.fill(road.fills[kind]);
    }
    if (road.goal) {
      c.fillStyle = colours.goal;
      c.globalAlpha = 0.6;
      c.fill(road.goal, "evenodd");
      c.globalAlpha = 1;
    }
    c.fillStyle = colours.arrow;
    c.fill(road.arrows);
  }

  borders(road) {
    this.c.strokeStyle = colours.border;
    this.c.lineWidth = 0.9 * this.px;
    this.c.stroke(road.borders);
  }

  // All steps' shapes: late ones below; with `step` > 0 that one stands out.
  sets(paths, horizon, step) {
    const { c } = this;
    for (let k = paths.length - 1; k >= 0; k--) {
      const colour = timeColour(k / Math.max(1, horizon));
      c.globalAlpha = step > 0 && k !== step ? 0.25 : 1;
      c.fillStyle = colour;
      c.strokeStyle = colour;
      c.lineWidth = 0.5 * this.px;
      c.fill(paths[k], "evenodd");
      c.stroke(paths[k]);
    }
    c.globalAlpha = 1;
    const marked = step > 0 ? paths[step] : paths[paths.length - 1];
    if (!marked) return;
    c.fillStyle = timeColour(step / Math.max(1, horizon));
    if (step > 0) c.fill(marked, "evenodd");
    c.strokeStyle = colours.ink;
    c.lineWidth = 1.2 * this.px;
    c.stroke(marked);
  }

  // Where others may be: all steps faint, the one that is looked at strong.
  occupancy(frames, step) {
    const { c } = this;
    c.fillStyle = colours.occupancy;
    c.strokeStyle = colours.occupancy;
    const last = frames.length - 1;
    const shown = step > 0 ? [last, step] : [last, Math.round(last * 0.6), Math.round(last * 0.3)];
    for (const k of shown) {
      if (!frames[k]) continue;
      const strong = step > 0 && k === step;
      c.globalAlpha = strong ? 0.4 : 0.12;
      c.fill(frames[k], "nonzero");
      c.globalAlpha = strong ? 1 : k === last ? 0.8 : 0;
      c.lineWidth = (strong ? 1.3 : 0.8) * this.px;
      c.setLineDash(strong ? [] : [5 * this.px, 3 * this.px]);
      if (c.globalAlpha) c.stroke(frames[k]);
      c.setLineDash([]);
    }
    c.globalAlpha = 1;
  }

  // What left no room: those in the way, and where the set would have been.
  blocking(decision, pair, step) {
    const { c } = this;
    if (pair.empty_step === null) return;
    for (const other of decision.others) {
      if (!pair.blocking.includes(other.id)) continue;
      const path = other.paths[Math.min(pair.empty_step, other.paths.length - 1)];
      if (!path) continue;
      c.fillStyle = colours.blocking;
      c.strokeStyle = colours.blocking;
      c.globalAlpha = 0.25;
      c.fill(path, "evenodd");
      c.globalAlpha = 1;
      c.lineWidth = 1.6 * this.px;
      c.stroke(path);
    }
    const contested = decision.shapes(pair.pair).contested;
    if (!contested) return;
    c.strokeStyle = colours.blocking;
    c.lineWidth = 1.5 * this.px;
    c.setLineDash([2.5 * this.px, 2.5 * this.px]);
    c.stroke(contested);
    c.setLineDash([]);
  }

  curve(curve) {
    const { c } = this;
    const fail = curve.kind === "fail-safe";
    const path = new Path2D();
    for (const row of curve.rows) path.lineTo(row.x, row.y);
    c.lineJoin = "round";
    c.strokeStyle = colours.halo;
    c.lineWidth = 4.2 * this.px;
    c.stroke(path);
    c.strokeStyle = fail ? colours["fail-safe"] : colours.planned;
    c.lineWidth = (fail ? 2.4 : 2) * this.px;
    const dashes = { "planned on": [6, 3], "fail-safe": [9, 2.5, 2, 2.5] }[curve.kind] || [];
    c.setLineDash(dashes.map((x) => x * this.px));
    c.stroke(path);
    c.setLineDash([]);
    if (fail && curve.rows.length) {
      const end = curve.rows[curve.rows.length - 1];
      c.fillStyle = colours["fail-safe"];
      c.beginPath();
      c.arc(end.x, end.y, 3.5 * this.px, 0, 7);
      c.fill();
    }
  }

  // A body at a pose; `look`: fill, edge, alpha, dashes.
  body(rings, pose, look) {
    if (!pose || Number.isNaN(pose.x) || !this.camera.sees(pose.x, pose.y)) return;
    const { c } = this;
    const cos = Math.cos(pose.heading),
      sin = Math.sin(pose.heading);
    c.beginPath();
    for (const ring of rings) {
      for (let i = 0; i < ring.length; i += 2) {
        const x = pose.x + cos * ring[i] - sin * ring[i + 1];
        const y = pose.y + sin * ring[i] + cos * ring[i + 1];
        if (i === 0) c.moveTo(x, y);
        else c.lineTo(x, y);
      }
      c.closePath();
    }
    c.globalAlpha = look.alpha ?? 1;
    if (look.fill) {
      c.fillStyle = look.fill;
      c.fill();
    }
    if (look.edge) {
      c.strokeStyle = look.edge;
      c.lineWidth = (look.wide ?? 1) * this.px;
      c.setLineDash((look.dashes || []).map((x) => x * this.px));
      c.stroke();
      c.setLineDash([]);
    }
    c.globalAlpha = 1;
  }

  // Words, upright whatever the camera does.
  words(x, y, text, { size = 11, colour = colours.ink, up = 0, bold = false } = {}) {
    const { c, camera, ratio } = this;
    const [px, py] = camera.screen(x, y);
    c.save();
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.font = `${bold ? "600 " : ""}${size}px system-ui, sans-serif`;
    c.textAlign = "center";
    c.textBaseline = "middle";
    c.lineJoin = "round";
    c.strokeStyle = colours.halo;
    c.lineWidth = 3;
    c.strokeText(text, px, py - up);
    c.fillStyle = colour;
    c.fillText(text, px, py - up);
    c.restore();
  }

  scaleBar() {
    const { c, camera, ratio } = this;
    const long = [1, 2, 5, 10, 20, 50, 100, 200].find((x) => x * camera.scale >= 50) || 500;
    const wide = long * camera.scale,
      y = camera.high - 14;
    c.save();
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.strokeStyle = colours.ink;
    c.lineWidth = 1.5;
    c.beginPath();
    c.moveTo(12, y - 4);
    c.lineTo(12, y);
    c.lineTo(12 + wide, y);
    c.lineTo(12 + wide, y - 4);
    c.stroke();
    c.fillStyle = colours.ink;
    c.font = "11px system-ui, sans-serif";
    c.textBaseline = "bottom";
    c.fillText(`${long} m`, 18 + wide, y + 3);
    c.restore();
  }
}

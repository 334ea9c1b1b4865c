// The map: a canvas, what is drawn on it now, and how long that takes.

const EGO_RING = (long, wide) => {
  const a = long / 2,
    b = wide / 2;
  // With a nose, so that one sees which way it points.
  return [new Float32Array([-a, -b, a - 0.8, -b, a, -b * 0.55, a, b * 0.55, a - 0.8, b, -a, b])];
};

class Stage {
  constructor(model) {
    this.model = model;
    this.camera = new Camera();
    this.canvas = el("canvas", {
      class: "map",
      role: "img",
      tabindex: "0",
      "aria-label": "Map of the road. Plus and minus zoom, arrow keys move it, F fits it.",
    });
    this.context = this.canvas.getContext("2d", { alpha: false });
    this.times = []; // of the last pictures [ms]
    steer(this.canvas, this.camera, () => {
      this.camera.touched = true;
      this.ask();
    });
    this.canvas.addEventListener("keydown", (event) => this.key(event));
    new ResizeObserver(() => this.resize()).observe(this.canvas);
    onChange(["index", "pair", "ahead", "time", "layers", "follow", "theme"], () => this.ask());
  }

  get decision() {
    return this.model.decisions[state.index];
  }

  key(event) {
    const move = {
      ArrowLeft: [40, 0],
      ArrowRight: [-40, 0],
      ArrowUp: [0, 40],
      ArrowDown: [0, -40],
    };
    if (!(event.key in move) || event.altKey || event.ctrlKey || event.metaKey) return;
    event.preventDefault();
    event.stopPropagation();
    this.camera.pan(...move[event.key]);
    this.camera.touched = true;
    this.ask();
  }

  zoom(factor) {
    this.camera.zoom(factor);
    this.camera.touched = true;
    this.ask();
  }

  fit() {
    this.camera.touched = false;
    this.frame();
    this.ask();
  }

  // Where the camera stands if the user has not moved it.
  frame() {
    if (!this.decision) return;
    if (!this.model.episode) {
      this.camera.fit(this.decision.data.focus);
      return;
    }
    const ego = this.egoNow();
    const wide = this.camera.wide < 600 ? 70 : 110;
    this.camera.scale = Math.min(this.camera.wide / wide, this.camera.high / 14);
    const ahead = 0.22 * (this.camera.wide / this.camera.scale);
    if (ego)
      this.camera.look(
        ego.x + ahead * Math.cos(ego.heading),
        ego.y + ahead * Math.sin(ego.heading),
      );
    // On a straight road the picture stands still across it.
    const [low, high] = this.model.road(this.decision.data.map).across;
    if (high - low < 40) this.camera.y = (low + high) / 2;
  }

  resize() {
    const wide = this.canvas.clientWidth;
    if (!wide || !this.decision) return;
    const [xLow, xHigh, yLow, yHigh] = this.decision.data.focus;
    let high = (wide * (yHigh - yLow)) / (xHigh - xLow);
    if (this.model.episode) high = wide / 3.6;
    high = Math.round(Math.min(Math.max(high, 230), Math.max(300, 0.55 * innerHeight), 520));
    this.canvas.style.height = `${high}px`;
    this.camera.resize(wide, high);
    if (!this.camera.touched) this.frame();
    this.ask();
  }

  ask() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(() => {
      this.asked = false;
      this.draw();
    });
  }

  egoNow() {
    const { ego } = this.decision.data;
    const track = this.model.tracks.find((track) => track.id === this.model.episode.ego);
    if (!track) return { ...ego };
    return between(track.rows, state.time / this.model.episode.dt - track.first);
  }

  draw() {
    const decision = this.decision;
    if (!decision || !this.canvas.clientWidth) return;
    const begin = performance.now();
    const ratio = Math.min(devicePixelRatio || 1, 2);
    const wide = Math.round(this.camera.wide * ratio),
      high = Math.round(this.camera.high * ratio);
    if (this.canvas.width !== wide || this.canvas.height !== high) {
      this.canvas.width = wide;
      this.canvas.height = high;
    }
    if (this.model.episode && state.follow && !this.camera.touched) this.frame();
    paint(new Painter(this.context, this.camera, ratio), this, decision);
    this.times.push(performance.now() - begin);
    if (this.times.length > 2000) this.times.shift();
  }
}

// The layers, bottom up.
function paint(painter, stage, decision) {
  const { c, camera, ratio } = painter;
  const { layers } = state;
  const data = decision.data;
  const ahead = Math.min(state.ahead, decision.end);
  const step = Math.min(Math.round(ahead / data.dt), data.horizon);
  const pair = decision.pair(state.pair);
  const shapes = decision.shapes(state.pair);
  const road = stage.model.road(data.map);
  c.setTransform(1, 0, 0, 1, 0, 0);
  c.globalAlpha = 1;
  c.fillStyle = colours["road-ground"];
  c.fillRect(0, 0, c.canvas.width, c.canvas.height);
  camera.apply(c, ratio);
  painter.road(road);
  if (layers.occupancy) painter.occupancy(decision.occupancy, step);
  if (layers.sets) {
    const paths = layers.corridor && shapes.corridor.length ? shapes.corridor : shapes.sets;
    painter.sets(paths, data.horizon, Math.min(step, paths.length));
  }
  painter.borders(road);
  if (layers.blocking && pair) painter.blocking(decision, pair);
  paintOthers(painter, stage, decision, ahead);
  if (layers.plan) for (const curve of decision.curves) painter.curve(curve);
  paintEgo(painter, stage, decision, ahead);
  for (const mark of data.marks) {
    painter.words(mark.x, mark.y, mark.text, { size: 11, bold: Boolean(mark.state) });
  }
  painter.scaleBar();
}

function paintOthers(painter, stage, decision, ahead) {
  const { model } = stage;
  const now = { fill: colours.other, edge: colours["other-edge"] };
  const seen = [];
  if (model.tracks.length && ahead === 0) {
    const tick = state.time / model.episode.dt;
    for (const track of model.tracks) {
      if (track.id === model.episode.ego) continue;
      const place = tick - track.first;
      if (place < -1e-6 || place > track.rows.length - 1 + 1e-6) continue;
      if (state.layers.past) paintPast(painter, track, place, model.episode.dt, colours.other);
      const pose = between(track.rows, place);
      painter.body(track.ring, pose, now);
      seen.push([track.id, pose]);
    }
  } else {
    for (const other of decision.others) {
      const pose = between(other.rows, ahead / decision.data.dt);
      if (ahead > 0 && !other.still) {
        painter.body(other.ring, other.rows[0], {
          edge: colours.other,
          alpha: 0.7,
          dashes: [3, 2],
        });
      }
      painter.body(other.ring, pose, now);
      seen.push([other.id, pose]);
    }
  }
  if (!state.layers.ids || painter.camera.scale < 3) return;
  for (const [id, pose] of seen) {
    if (pose && painter.camera.sees(pose.x, pose.y, 0)) {
      painter.words(pose.x, pose.y, String(id), { size: 10, up: 0.9 * painter.camera.scale + 8 });
    }
  }
}

// Bodies of the last second, the older the fainter.
function paintPast(painter, track, place, dt, colour) {
  for (let age = 5; age >= 1; age--) {
    const past = place - (0.2 * age) / dt;
    if (past < 0) continue;
    painter.body(track.ring, between(track.rows, past), {
      fill: colour,
      alpha: 0.28 - 0.045 * age,
    });
  }
}

function paintEgo(painter, stage, decision, ahead) {
  const { ego } = decision.data;
  const { model } = stage;
  const ring = EGO_RING(ego.length, ego.width);
  const look = { fill: colours.ego, edge: colours.ink };
  if (model.tracks.length && ahead === 0) {
    const track = model.tracks.find((track) => track.id === model.episode.ego);
    if (track) {
      const place = state.time / model.episode.dt - track.first;
      if (state.layers.past)
        paintPast(painter, { ...track, ring }, place, model.episode.dt, colours.ego);
      painter.body(ring, between(track.rows, place), look);
      return;
    }
  }
  if (ahead === 0) {
    painter.body(ring, ego, look);
    return;
  }
  painter.body(ring, ego, { edge: colours.ego, alpha: 0.8, dashes: [3, 2] });
  const planned = decision.along(false, ahead),
    fail = decision.along(true, ahead);
  if (fail)
    painter.body(ring, fail, {
      fill: colours["fail-safe"],
      edge: colours.ink,
      alpha: planned ? 0.75 : 1,
    });
  if (planned && ahead <= decision.data.horizon * decision.data.dt + 1e-6)
    painter.body(ring, planned, look);
}

// The document, unpacked when it is first looked at.

class Decision {
  constructor(data) {
    this.data = data;
    this.end = Math.max(data.horizon * data.dt, ...data.curves.map((curve) => curve.end));
  }

  once(name, make) {
    const key = `_${name}`;
    if (!(key in this)) this[key] = make();
    return this[key];
  }

  get others() {
    return this.once("others", () =>
      this.data.others.map((other) => ({
        ...other,
        ring: unpackFrames(other.outline)[0],
        rows: unpackStates(other.states),
        paths: other.occupancy ? unpackFrames(other.occupancy).map(pathOf) : [],
      })),
    );
  }

  // Where all others may be, together, at each step.
  get occupancy() {
    return this.once("occupancy", () => {
      const frames = [];
      for (let k = 0; k <= this.data.horizon; k++) {
        const all = new Path2D();
        for (const other of this.others) {
          const path = other.paths[Math.min(k, other.paths.length - 1)];
          if (path) all.addPath(path);
        }
        frames.push(all);
      }
      return frames;
    });
  }

  get curves() {
    return this.once("curves", () =>
      this.data.curves.map((curve) => ({ ...curve, rows: unpackStates(curve.states) })),
    );
  }

  pair(name) {
    return this.data.pairs.find((pair) => pair.pair === name) || null;
  }

  // Paths of a pair's set, of its corridor, and of where it would have been.
  shapes(name) {
    return this.once(`shapes ${name}`, () => {
      const pair = this.pair(name);
      if (!pair) return { sets: [], corridor: [], contested: null };
      return {
        sets: unpackFrames(pair.sets).map(pathOf),
        corridor: pair.corridor ? unpackFrames(pair.corridor).map(pathOf) : [],
        contested: pair.contested ? pathOf(unpackFrames(pair.contested)[0]) : null,
      };
    });
  }

  // The ego at a time from the decision on, along a kind of curve; null where there is none.
  along(fail, time) {
    let found = null;
    for (const curve of this.curves) {
      if ((curve.kind === "fail-safe") !== fail || curve.rows.length === 0) continue;
      if (time < curve.start - 1e-9) continue;
      found = between(curve.rows, (time - curve.start) / curve.dt);
    }
    return found;
  }

  get driven() {
    return this.data.pairs.find((pair) => pair.executed) || null;
  }

  // What is shown first: what is driven, else the first ranked, else the first.
  get first() {
    const pairs = this.data.pairs;
    const found = this.driven || pairs.find((pair) => pair.rank === 1) || pairs[0];
    return found ? found.pair : null;
  }
}

function pathOf(rings) {
  const path = new Path2D();
  for (const ring of rings) {
    for (let i = 0; i < ring.length; i += 2) {
      if (i === 0) path.moveTo(ring[0], ring[1]);
      else path.lineTo(ring[i], ring[i + 1]);
    }
    path.closePath();
  }
  return path;
}

function roadOf(map) {
  const fills = { lane: new Path2D(), current: new Path2D(), other: new Path2D() };
  const borders = new Path2D(),
    arrows = new Path2D();
  const across = [Infinity, -Infinity]; // lowest and highest y of all
  for (const lane of map.lanes) {
    const [left, right] = unpackFrames(lane.borders)[0];
    const ring = new Float32Array(left.length + right.length);
    ring.set(right);
    for (let i = 0; i < left.length; i += 2) {
      ring[ring.length - i - 2] = left[i];
      ring[ring.length - i - 1] = left[i + 1];
    }
    (fills[lane.kind] || fills.lane).addPath(pathOf([ring]));
    for (const line of [left, right]) {
      for (let i = 0; i < line.length; i += 2) {
        if (i === 0) borders.moveTo(line[0], line[1]);
        else borders.lineTo(line[i], line[i + 1]);
        across[0] = Math.min(across[0], line[i + 1]);
        across[1] = Math.max(across[1], line[i + 1]);
      }
    }
    if (lane.kind !== "other") addArrows(arrows, left, right);
  }
  return {
    fills,
    borders,
    arrows,
    across,
    goal: map.goal ? pathOf(unpackFrames(map.goal)[0]) : null,
  };
}

// Small arrow heads along the middle of a lane, where both borders have as many points.
function addArrows(path, left, right) {
  const n = Math.min(left.length, right.length) / 2;
  if (left.length !== right.length) return;
  let left_over = 10;
  for (let i = 1; i < n; i++) {
    const at = (k, c) => (left[2 * k + c] + right[2 * k + c]) / 2;
    const dx = at(i, 0) - at(i - 1, 0),
      dy = at(i, 1) - at(i - 1, 1);
    const long = Math.hypot(dx, dy);
    if (long < 1e-6) continue;
    const ux = dx / long,
      uy = dy / long;
    let s = left_over;
    for (; s < long; s += 20) {
      const x = at(i - 1, 0) + ux * s,
        y = at(i - 1, 1) + uy * s;
      path.moveTo(x + 0.9 * ux, y + 0.9 * uy);
      path.lineTo(x - 0.9 * ux - 0.45 * uy, y - 0.9 * uy + 0.45 * ux);
      path.lineTo(x - 0.4 * ux, y - 0.4 * uy);
      path.lineTo(x - 0.9 * ux + 0.45 * uy, y - 0.9 * uy - 0.45 * ux);
      path.closePath();
    }
    left_over = s - long;
  }
}

class Model {
  constructor(data) {
    this.data = data;
    this.decisions = data.decisions.map((decision) => new Decision(decision));
    this.episode = data.episode;
    this.roads = new Map();
  }

  road(index) {
    if (!this.roads.has(index)) this.roads.set(index, roadOf(this.data.maps[index]));
    return this.roads.get(index);
  }

  get tracks() {
    if (!this._tracks && this.episode) {
      this._tracks = this.episode.tracks.map((track) => ({
        ...track,
        ring: unpackFrames(track.outline)[0],
        rows: unpackStates(track.states),
      }));
    }
    return this._tracks || [];
  }

  // More decisions of an episode that is being driven.
  extend(news) {
    Object.assign(this.data, { maps: news.maps, texts: news.texts, episode: news.episode });
    this.data.decisions.push(...news.decisions);
    this.decisions.push(...news.decisions.map((decision) => new Decision(decision)));
    this.episode = news.episode;
    this._tracks = null;
  }

  get duration() {
    return this.episode ? (this.episode.ticks - 1) * this.episode.dt : 0;
  }

  // Whether nothing was decided: a driver without a verifier drove.
  get bare() {
    return this.decisions.every(({ data }) => data.pairs.length === 0 && data.prompt.user === "");
  }

  // The decision that is in force at a time.
  at(time) {
    let index = 0;
    for (let i = 0; i < this.decisions.length; i++) {
      if (this.decisions[i].data.time <= time + 1e-6) index = i;
    }
    return index;
  }
}

// Reads what sandra/view/report/packing.py has written: frames of rings, rows of states.

const ABSENT = -(2 ** 30);

function integers(text) {
  const bytes = atob(text);
  const found = [];
  let value = 0,
    factor = 1;
  for (let i = 0; i < bytes.length; i++) {
    const byte = bytes.charCodeAt(i);
    value += (byte & 127) * factor;
    factor *= 128;
    if (byte < 128) {
      found.push(value % 2 ? -(value + 1) / 2 : value / 2);
      value = 0;
      factor = 1;
    }
  }
  return found;
}

// -> one list of rings for each step, each ring a flat [x, y, x, y, ...] in metres.
function unpackFrames(text) {
  const stream = integers(text);
  let at = 0,
    x = 0,
    y = 0;
  const frames = new Array(stream[at++]);
  for (let f = 0; f < frames.length; f++) {
    const rings = new Array(stream[at++]);
    for (let r = 0; r < rings.length; r++) {
      const count = stream[at++];
      const ring = new Float32Array(2 * count);
      for (let p = 0; p < count; p++) {
        x += stream[at++];
        y += stream[at++];
        ring[2 * p] = x / 100;
        ring[2 * p + 1] = y / 100;
      }
      rings[r] = ring;
    }
    frames[f] = rings;
  }
  return frames;
}

// -> rows {x, y, heading, speed, acceleration}, NaN where nothing is known.
function unpackStates(text) {
  const stream = integers(text);
  const count = stream[0],
    columns = stream[1];
  const scales = [100, 100, 1000, 100, 100];
  const above = new Array(columns).fill(0);
  const rows = new Array(count);
  let at = 2;
  for (let i = 0; i < count; i++) {
    const row = [];
    for (let c = 0; c < columns; c++) {
      above[c] += stream[at++];
      row.push(above[c] === ABSENT ? NaN : above[c] / scales[c]);
    }
    rows[i] = { x: row[0], y: row[1], heading: row[2], speed: row[3], acceleration: row[4] };
  }
  return rows;
}

// The state between two rows; NaN where one of them is not known.
function between(rows, place) {
  const last = rows.length - 1;
  if (last < 0) return null;
  const low = Math.min(Math.max(Math.floor(place), 0), last);
  const high = Math.min(low + 1, last);
  const part = Math.min(Math.max(place - low, 0), 1);
  const a = rows[low],
    b = rows[high];
  if (part === 0 || low === high) return a;
  if (Number.isNaN(b.x)) return a;
  const mixed = {};
  for (const key of ["x", "y", "heading", "speed"]) mixed[key] = a[key] + part * (b[key] - a[key]);
  mixed.acceleration = a.acceleration;
  return mixed;
}

// What is shown now, and who wants to know when it changes.

const state = {
  index: 0, // which decision
  pair: null, // text of the pair whose set is shown
  ahead: 0, // how far into the plan of that decision [s]
  time: 0, // since the start of the episode [s]
  playing: false,
  follow: true,
  layers: {
    sets: true,
    corridor: false,
    occupancy: true,
    plan: true,
    blocking: true,
    ids: true,
    past: true,
  },
};

const listeners = [];
let asked = null;
let changed = new Set();

// With a node, the listener is forgotten once that node is no longer on the page.
function onChange(keys, listener, node = null) {
  listeners.push({ keys, listener, node });
}

function change(news) {
  for (const [key, value] of Object.entries(news)) {
    if (state[key] === value) continue;
    state[key] = value;
    changed.add(key);
  }
  if (changed.size && asked === null) asked = requestAnimationFrame(tell);
}

function tell() {
  const keys = changed;
  asked = null;
  changed = new Set();
  const alive = listeners.filter(({ node }) => node === null || node.isConnected);
  listeners.splice(0, listeners.length, ...alive);
  for (const { keys: wanted, listener } of alive) {
    if (wanted.some((key) => keys.has(key))) listener(keys);
  }
}

// For what is long to read: it waits until the time rests, so that the map moves smoothly.
function atRest(act, node, wait = 90) {
  let timer = null;
  return () => {
    clearTimeout(timer);
    timer = setTimeout(() => node.isConnected && act(), wait);
  };
}

function forget() {
  listeners.length = 0;
}

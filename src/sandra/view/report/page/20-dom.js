// Elements are made here and nowhere else. Text is text: nothing is ever read as HTML.

const SVG = "http://www.w3.org/2000/svg";

function fill(node, attributes, children) {
  for (const [name, value] of Object.entries(attributes || {})) {
    if (value === undefined || value === null || value === false) continue;
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (name === "style")
      for (const [k, v] of Object.entries(value)) node.style.setProperty(k, v);
    else if (name === "value") node.value = value;
    else node.setAttribute(name, value === true ? "" : String(value));
  }
  for (const child of children.flat(Infinity)) {
    if (child === undefined || child === null || child === false) continue;
    node.append(child instanceof Node ? child : document.createTextNode(String(child)));
  }
  return node;
}

const el = (tag, attributes, ...children) =>
  fill(document.createElement(tag), attributes, children);
const svg = (tag, attributes, ...children) =>
  fill(document.createElementNS(SVG, tag), attributes, children);

function replaceIn(node, ...children) {
  node.replaceChildren();
  return fill(node, null, children);
}

// Links lead to pages beside this one, never elsewhere: a document may not choose a scheme.
function link(href, text) {
  const safe = /^(\.\.\/)?[\w-][\w./-]*\.html(#[\w=&-]*)?$/.test(href) && !href.startsWith("/");
  return safe ? el("a", { href }, text) : el("span", null, text);
}

const card = (title, attributes, ...children) =>
  el("section", { class: "card", ...attributes }, title && el("h2", null, title), ...children);

const number = (value, digits = 1) =>
  value === null || value === undefined || Number.isNaN(value) ? "–" : value.toFixed(digits);

// So long a text is shown whole in a box that scrolls, and so much of it at once.
const LONGEST = 200000;

function textBox(text, label) {
  const shown = text.length > LONGEST ? text.slice(0, LONGEST) : text;
  return [
    el("pre", { tabindex: "0", "aria-label": label, class: "text" }, shown),
    text.length > LONGEST &&
      el("p", { class: "faint" }, `The first ${LONGEST} of ${text.length} characters are shown.`),
  ];
}

function say(text) {
  document.getElementById("spoken").textContent = text;
}

const SYMBOLS = { UNSAFE: "✗", REACHABLE: "✓", CERTIFIED: "✔" };

const badge = (status) =>
  el(
    "span",
    { class: `badge ${status in SYMBOLS ? status.toLowerCase() : ""}` },
    el("span", { "aria-hidden": "true" }, `${SYMBOLS[status] || "?"} `),
    status,
  );

const unitText = (unit) => unit.replaceAll("^2", "²");

const pairName = (pair) => pair.replace(",", ", ");

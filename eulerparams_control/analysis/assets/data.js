// What the page was made of: its elements, and the data that it carries.

const $ = (selector, within = document) => within.querySelector(selector);
const $$ = (selector, within = document) => [...within.querySelectorAll(selector)];
const read = id => JSON.parse(document.getElementById(id).textContent);
const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

const KINDS = {f4: Float32Array, u2: Uint16Array, u4: Uint32Array, i2: Int16Array};

function unpack(array) {  // base64 of the bytes of an array
  if (!array) return null;
  const text = atob(array.bdata);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return new KINDS[array.dtype](bytes.buffer);
}

function create(tag, className, parent) {
  const element = document.createElement(tag);
  element.className = className;
  parent.append(element);
  return element;
}

const attempt = action => {  // where a browser forbids something that the page can do without
  try { return action(); } catch { return null; }
};

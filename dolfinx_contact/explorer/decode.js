// The arrays of the page: base64, deflated, byte plane by byte plane; each is unpacked when it is
// asked for first.
"use strict";

const META = JSON.parse(document.getElementById("meta").textContent);
const KINDS = {
  i1: Int8Array, u1: Uint8Array, i2: Int16Array, i4: Int32Array, f4: Float32Array, f8: Float64Array,
};
const unpacked = new Map();

async function inflate(id) {
  const text = atob(document.getElementById(id).textContent.trim());
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

async function unpack(name) {
  const words = META.arrays[name];
  const planes = await inflate("array:" + name);
  if (words.dtype === "text") return new TextDecoder().decode(planes);
  const Kind = KINDS[words.dtype];
  const size = Kind.BYTES_PER_ELEMENT;
  const count = planes.length / size;
  const bytes = new Uint8Array(planes.length);
  for (let k = 0; k < size; k++)
    for (let i = 0; i < count; i++) bytes[i * size + k] = planes[k * count + i];
  if (words.xor && words.shape[0] > 1) {
    const row = bytes.length / words.shape[0];
    for (let i = row; i < bytes.length; i++) bytes[i] ^= bytes[i - row];
  }
  return new Kind(bytes.buffer);
}

/** An array by its name, as a typed array (or a text); rows follow one another. */
function array(name) {
  if (!unpacked.has(name)) unpacked.set(name, unpack(name));
  return unpacked.get(name);
}

/** Linear interpolation of two arrays; the first one itself at share 0. */
async function mixed(read, state) {
  const low = await read(state.low);
  if (!state.share) return low;
  const high = await read(state.high);
  return low.map((value, i) => value + state.share * (high[i] - value));
}

/** Values of a packed field at a state, also between two recorded ones: Float32Array by vertex. */
function fieldAt(field, state) {
  return mixed((number) => recordedField(field, number), state);
}

async function recordedField(field, state) {
  const values = new Float32Array(field.vertices * field.components);
  let block = field.blocks[0];
  for (const other of field.blocks) if (other.first <= state) block = other;
  const [modes, steps, parts] = await Promise.all(
    [block.modes, block.steps, block.parts].map(array));
  const row = (state - block.first) * steps.length;
  for (let k = 0; k < steps.length; k++) {
    const part = parts[row + k] * steps[k];
    const from = k * values.length;
    for (let i = 0; i < values.length; i++) values[i] += part * modes[from + i];
  }
  return values;
}

/** Contact table of a surface at a state, also between two recorded ones: columns by name. */
async function tableAt(surface, state) {
  const low = await recordedTable(surface, state.low);
  if (!low || !state.share) return low;
  const high = await recordedTable(surface, state.high);
  const table = {};
  for (const [name, values] of Object.entries(low)) {
    table[name] = values instanceof Uint8Array ? (state.lettersOfHigh ? high : low)[name]
      : values.map((value, i) => value + state.share * (high[name][i] - value));
  }
  return table;
}

async function recordedTable(surface, state) {
  if (!surface.groups.length) return null;
  let group = surface.groups[0];
  for (const other of surface.groups) if (other.first <= state) group = other;
  const names = Object.keys(group.arrays);
  const arrays = await Promise.all(names.map((name) => array(group.arrays[name])));
  const table = {};
  names.forEach((name, i) => {
    const row = surface.points * surface.components[name];
    const at = (state - group.first) * row;
    table[name] = arrays[i].subarray(at, at + row);
  });
  // Records hold the bound of the friction force; the page shows it next to the shear.
  table.bound = table.bound.map((force, i) => (table.area[i] > 0 ? force / table.area[i] : 0));
  return table;
}

/**
 * Numeric arrays of the scene: text to numbers.
 *
 * @typedef {object} Block
 * @property {number} count how many numbers
 * @property {number} scale step of the numbers
 * @property {number} offset the number that the integer 0 stands for
 * @property {number} order differences to undo: 0, 1 or 2
 * @property {number} bytes bytes of an integer
 * @property {string} data base64 of a raw deflate stream of byte planes
 * @property {boolean} [nan] whether the integer 0 stands for NaN, and others are one too large
 */

/**
 * Decode a block.
 * @param {Block} block
 * @returns {Promise<Float64Array>}
 */
export async function decodeBlock(block) {
  const values = new Float64Array(block.count);
  if (!block.count) return values;

  // The integers: byte planes, the least significant first.
  const bytes = await inflate(fromBase64(block.data));
  for (let plane = 0, weight = 1; plane < block.bytes; plane++, weight *= 256) {
    const start = plane * block.count;
    for (let i = 0; i < block.count; i++) values[i] += bytes[start + i] * weight;
  }

  // Their signs, differences and scale.
  undoZigzag(values, block.nan === true);
  for (let order = 0; order < block.order; order++) {
    for (let i = 1; i < values.length; i++) values[i] += values[i - 1];
  }
  for (let i = 0; i < values.length; i++) values[i] = values[i] * block.scale + block.offset;
  return values;
}

/**
 * Unpack a text.
 * @param {string} data base64 of a raw deflate stream
 */
export async function unpackText(data) {
  return new TextDecoder().decode(await inflate(fromBase64(data)));
}

/**
 * Unfold integers in place: 0, 1, 2, 3, 4 become 0, -1, 1, -2, 2.
 * @param {Float64Array} values
 * @param {boolean} hasNan whether 0 stands for NaN, and others are one too large
 */
function undoZigzag(values, hasNan) {
  for (let i = 0; i < values.length; i++) {
    const value = hasNan ? values[i] - 1 : values[i];
    if (value < 0) values[i] = NaN;
    else values[i] = value % 2 ? -(value + 1) / 2 : value / 2;
  }
}

/**
 * Bytes of base64 text.
 * @param {string} text
 * @returns {Uint8Array<ArrayBuffer>}
 */
function fromBase64(text) {
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let i = 0; i < binary.length; i++) bytes[i] = binary.charCodeAt(i);
  return bytes;
}

/**
 * Inflate a raw deflate stream.
 * @param {Uint8Array<ArrayBuffer>} bytes
 * @returns {Promise<Uint8Array>}
 */
async function inflate(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// The two kinds of files the daemon answers with that a browser does not read: meshes (.glb) and maps (OpenEXR), as far as rigd writes them.

/// A mesh as the daemon sends it: vertices about its middle in lengths of its radius, and what puts them back.
export function readMesh(buffer) {
  const words = new DataView(buffer);
  const length = words.getUint32(12, true);
  const told = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 20, length)));
  const start = 28 + length;
  const [node] = told.nodes;
  const [{ attributes, indices }] = told.meshes[0].primitives;
  const numbers = (index, Kind) => {
    const { byteOffset, byteLength } = told.bufferViews[told.accessors[index].bufferView];
    return new Kind(buffer, start + byteOffset, byteLength / Kind.BYTES_PER_ELEMENT);
  };
  return {
    positions: numbers(attributes.POSITION, Float32Array), normals: numbers(attributes.NORMAL, Float32Array),
    uv: node.extras.textured ? numbers(attributes.TEXCOORD_0, Float32Array) : null, corners: numbers(indices, Uint32Array),
    middle: node.translation, radius: node.scale[0], extent: node.extras.extent, dropped: node.extras.dropped,
  };
}

/// Every channel of an uncompressed OpenEXR file of 32-bit floats, by its name, row by row.
export function readMaps(buffer) {
  const bytes = new DataView(buffer);
  let at = 8;
  const text = () => {
    const from = at;
    while (bytes.getUint8(at)) at++;
    return new TextDecoder().decode(new Uint8Array(buffer, from, at++ - from));
  };
  const names = [];
  let size = [0, 0];
  for (let name = text(); name; name = text()) {
    const kind = text();
    const end = bytes.getInt32(at, true) + (at += 4);
    if (kind === "chlist") {
      while (bytes.getUint8(at)) {
        names.push(text());
        at += 16;
      }
    } else if (name === "dataWindow") {
      const [left, top, right, bottom] = [0, 4, 8, 12].map((offset) => bytes.getInt32(at + offset, true));
      size = [right - left + 1, bottom - top + 1];
    } else if (name === "compression" && bytes.getUint8(at) !== 0) throw new Error("the maps are compressed");
    at = end;
  }
  const [columns, rows] = size;
  const planes = Object.fromEntries(names.map((name) => [name, new Float32Array(columns * rows)]));
  for (let row = 0; row < rows; row++) {
    // Its place stands in a table; there its own number, its length, then the channels.
    const from = Number(bytes.getBigUint64(at + 8 * row, true)) + 8;
    names.forEach((name, i) => {
      const start = from + 4 * columns * i;
      planes[name].set(new Float32Array(buffer.slice(start, start + 4 * columns)), columns * row);
    });
  }
  return { columns, rows, planes };
}

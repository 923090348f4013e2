/* Trained policies in the browser: a graph of a few ONNX operators, run node by node in single precision.
   fpgPolicy({ nodes, weights, state }) gives (observation) => action, with a memory of its own. */
"use strict";
const fpgPolicy = (() => {
  const f32 = Math.fround;
  const count = (shape) => shape.reduce((product, size) => product * size, 1);
  const tensor = (shape, data) => ({ shape, data });

  /** Weights as they were written: a tensor, little-endian numbers of 32 bits, or a list of integers. */
  function read({ shape, data, floats, integers }) {
    if (data) return tensor(shape, data);
    if (integers) return tensor(shape, integers);
    const bytes = Uint8Array.from(atob(floats), (sign) => sign.charCodeAt(0));
    return tensor(shape, new Float32Array(bytes.buffer));
  }

  const each = (of) => ([x]) => tensor(x.shape, x.data.map(of));
  const sigmoid = (x) => 1 / (1 + Math.exp(-x));
  const places = (axes, rank) => axes.map((axis) => (axis < 0 ? axis + rank : axis));

  function gemm([a, b, c], { transA = 0, transB = 0, alpha = 1, beta = 1 }) {
    if (transA || a.shape.length !== 2 || b.shape.length !== 2) throw new Error("Gemm and MatMul: only two axes, not turned, are played");
    const [rows, inner] = a.shape, columns = b.shape[transB ? 0 : 1];
    const out = new Float32Array(rows * columns);
    for (let i = 0; i < rows; i++)
      for (let j = 0; j < columns; j++) {
        let sum = 0;
        for (let k = 0; k < inner; k++) sum += a.data[i * inner + k] * (transB ? b.data[j * inner + k] : b.data[k * columns + j]);
        out[i * columns + j] = alpha * sum + (c ? beta * c.data[c.data.length === 1 ? 0 : j] : 0);
      }
    return tensor([rows, columns], out);
  }

  function clip([x, low, high]) {
    const least = low ? low.data[0] : -Infinity, most = high ? high.data[0] : Infinity;
    return tensor(x.shape, x.data.map((value) => Math.min(Math.max(value, least), most)));
  }

  /** Values at the places that `from` gives for each index of a new shape. */
  function gathered(shape, x, from) {
    const out = x.data instanceof Float32Array ? new Float32Array(count(shape)) : new Array(count(shape)).fill(0);
    const index = shape.map(() => 0);
    for (let i = 0; i < out.length; i++) {
      const place = from(index);
      out[i] = x.data[place.reduce((sum, at, axis) => sum * x.shape[axis] + at, 0)];
      for (let axis = shape.length - 1; axis >= 0 && ++index[axis] === shape[axis]; axis--) index[axis] = 0;
    }
    return tensor(shape, out);
  }

  function slice([x, starts, ends, axes, steps]) {
    const rank = x.shape.length, shape = [...x.shape], from = x.shape.map(() => 0);
    const along = axes ? places([...axes.data], rank) : [...starts.data.keys()];
    if (steps && [...steps.data].some((step) => step !== 1)) throw new Error("Slice: steps other than 1 are not played");
    along.forEach((axis, i) => {
      const size = x.shape[axis], bound = (at) => Math.max(0, Math.min(size, at < 0 ? at + size : at));
      from[axis] = bound(starts.data[i]);
      shape[axis] = Math.max(0, bound(ends.data[i]) - from[axis]);
    });
    return gathered(shape, x, (index) => index.map((at, axis) => at + from[axis]));
  }

  function concat(inputs, { axis }) {
    const [first] = inputs, along = places([axis], first.shape.length)[0];
    const shape = first.shape.map((size, at) => (at === along ? inputs.reduce((sum, x) => sum + x.shape[along], 0) : size));
    const inner = count(first.shape.slice(along + 1)), outer = count(first.shape.slice(0, along));
    const parts = [];
    for (let i = 0; i < outer; i++) for (const x of inputs) parts.push(...x.data.slice(i * x.shape[along] * inner, (i + 1) * x.shape[along] * inner));
    return tensor(shape, first.data instanceof Float32Array ? Float32Array.from(parts) : parts);
  }

  function reshape([x, wanted]) {
    const shape = [...wanted.data].map((size, axis) => (size === 0 ? x.shape[axis] : size));
    const open = shape.indexOf(-1);
    if (open >= 0) shape[open] = x.data.length / -count(shape);
    return tensor(shape, x.data);
  }

  function transpose([x], { perm }) {
    return gathered(perm.map((axis) => x.shape[axis]), x, (index) => {
      const place = [];
      perm.forEach((axis, at) => (place[axis] = index[at]));
      return place;
    });
  }

  function gather([x, indices], { axis = 0 }) {
    const along = places([axis], x.shape.length)[0], size = x.shape[along];
    const shape = [...x.shape.slice(0, along), ...indices.shape, ...x.shape.slice(along + 1)];
    const chosen = (index) => indices.data[index.slice(along, along + indices.shape.length).reduce((sum, at, i) => sum * indices.shape[i] + at, 0)];
    return gathered(shape, x, (index) => {
      const at = chosen(index);
      return [...index.slice(0, along), at < 0 ? at + size : at, ...index.slice(along + indices.shape.length)];
    });
  }

  function unsqueeze([x, axes]) {
    const rank = x.shape.length + axes.data.length, added = places([...axes.data], rank), left = [...x.shape];
    return tensor(Array.from({ length: rank }, (_, axis) => (added.includes(axis) ? 1 : left.shift())), x.data);
  }

  function squeeze([x, axes]) {
    const gone = axes ? places([...axes.data], x.shape.length) : x.shape.flatMap((size, axis) => (size === 1 ? [axis] : []));
    return tensor(x.shape.filter((_, axis) => !gone.includes(axis)), x.data);
  }

  /** The place of the first of the largest values along the last axis. */
  function argmax([x], { axis = 0, keepdims = 1 }) {
    const last = x.shape.length - 1, size = x.shape[last];
    if (places([axis], x.shape.length)[0] !== last) throw new Error("ArgMax: only the last axis is played");
    const data = [];
    for (let i = 0; i < x.data.length; i += size) {
      const values = x.data.slice(i, i + size);
      data.push(values.indexOf(Math.max(...values)));
    }
    return tensor([...x.shape.slice(0, last), ...(keepdims ? [1] : [])], data);
  }

  /** A tensor repeated along axes of size 1, to a shape. */
  function spread(x, shape) {
    if (x.data.length === count(shape)) return x.data;
    const begin = shape.length - x.shape.length;
    if (begin < 0 || x.shape.some((size, axis) => size !== 1 && size !== shape[begin + axis])) throw new Error(`${x.shape} is not played as ${shape}`);
    return gathered(shape, x, (index) => x.shape.map((size, axis) => (size === 1 ? 0 : index[begin + axis]))).data;
  }

  /** An operator on tensors, number by number, from the first to the last. */
  const pairwise = (of) => (inputs) => inputs.reduce((a, b) => {
    const rank = Math.max(a.shape.length, b.shape.length), size = (x, axis) => x.shape[axis - rank + x.shape.length] ?? 1;
    const shape = Array.from({ length: rank }, (_, axis) => (size(a, axis) === 1 ? size(b, axis) : size(a, axis)));
    const [left, right] = [spread(a, shape), spread(b, shape)];
    return tensor(shape, left.map((x, i) => of(x, right[i])));
  });

  function softmax([x], { axis = -1 }) {
    const last = x.shape.length - 1, size = x.shape[last], out = new Float32Array(x.data.length);
    if (places([axis], x.shape.length)[0] !== last) throw new Error("Softmax: only the last axis is played");
    for (let i = 0; i < out.length; i += size) {
      const row = x.data.slice(i, i + size), most = Math.max(...row), parts = row.map((value) => Math.exp(value - most));
      const total = parts.reduce((sum, part) => sum + part, 0);
      out.set(parts.map((part) => part / total), i);
    }
    return tensor(x.shape, out);
  }

  function flatten([x], { axis = 1 }) {
    const rows = count(x.shape.slice(0, places([axis], x.shape.length)[0]));
    return tensor([rows, x.data.length / rows], x.data);
  }

  function constant(_, { value, value_float: float, value_floats: floats, value_int: int, value_ints: ints }) {
    return value ?? (floats || float !== undefined ? tensor(floats ? [floats.length] : [], Float32Array.from(floats ?? [float])) : tensor(ints ? [ints.length] : [], ints ?? [int]));
  }

  function reduceSum([x, axes]) {
    if (x.shape[0] !== 1 || String(axes.data) !== String(x.shape.length - 1)) throw new Error("ReduceSum: only one row is played");
    return tensor([1, 1], Float32Array.of(x.data.reduce((total, value) => f32(total + value), 0)));
  }

  /** One layer, forwards, gates in the order input, output, forget, cell. */
  function lstm([x, w, r, b, , h0, c0], { hidden_size: size, direction = "forward" }) {
    if (direction !== "forward" || x.shape[1] !== 1) throw new Error("LSTM: only one row, forwards, is played");
    const [length, , wide] = x.shape, all = [];
    let h = h0 ? Float32Array.from(h0.data) : new Float32Array(size), c = c0 ? Float32Array.from(c0.data) : new Float32Array(size);
    for (let t = 0; t < length; t++) {
      const sums = Array.from({ length: 4 * size }, (_, gate) => {
        let sum = b ? b.data[gate] + b.data[4 * size + gate] : 0;
        for (let k = 0; k < wide; k++) sum += w.data[gate * wide + k] * x.data[t * wide + k];
        for (let k = 0; k < size; k++) sum += r.data[gate * size + k] * h[k];
        return sum;
      });
      c = c.map((value, k) => sigmoid(sums[2 * size + k]) * value + sigmoid(sums[k]) * Math.tanh(sums[3 * size + k]));
      h = c.map((value, k) => sigmoid(sums[size + k]) * Math.tanh(value));
      all.push(...h);
    }
    return [tensor([length, 1, 1, size], Float32Array.from(all)), tensor([1, 1, size], h), tensor([1, 1, size], c)];
  }

  const PLAYED = {
    Gemm: gemm, Tanh: each((x) => f32(Math.tanh(x))), Relu: each((x) => Math.max(0, x)), Sigmoid: each((x) => f32(sigmoid(x))), Clip: clip,
    Slice: slice, Concat: concat, Reshape: reshape, Transpose: transpose, Gather: gather, Unsqueeze: unsqueeze, Squeeze: squeeze,
    ArgMax: argmax, Softmax: softmax, Flatten: flatten, Constant: constant, Identity: ([x]) => x, LSTM: lstm, MatMul: ([a, b]) => gemm([a, b], {}), ReduceSum: reduceSum, Abs: each(Math.abs), Sqrt: each(Math.sqrt),
    Neg: each((x) => -x), Exp: each(Math.exp), Elu: ([x], { alpha = 1 }) => each((y) => (y < 0 ? alpha * (Math.exp(y) - 1) : y))([x]),
    LeakyRelu: ([x], { alpha = 0.01 }) => each((y) => (y < 0 ? alpha * y : y))([x]),
    Sum: pairwise((x, y) => x + y), Add: pairwise((x, y) => x + y), Sub: pairwise((x, y) => x - y), Mul: pairwise((x, y) => x * y),
    Div: pairwise((x, y) => x / y), Max: pairwise(Math.max), Min: pairwise(Math.min),
  };

  /** A player of one round; its memory begins empty. */
  function make({ nodes, weights, state }) {
    const held = Object.fromEntries(Object.entries(weights).map(([name, weight]) => [name, read(weight)]));
    let memory = new Float32Array(state);
    return (seen) => {
      const known = { ...held, observation: tensor([1, seen.length], Float32Array.from(seen)), state: tensor([1, state], memory) };
      for (const { op, inputs, outputs, attributes } of nodes) {
        const values = PLAYED[op](inputs.map((name) => known[name]), attributes);
        [values].flat().forEach((one, i) => (known[outputs[i]] = one));
      }
      if (state) memory = known.next_state.data;
      return Array.from(known.action.data);
    };
  }

  return { make, OPERATORS: Object.keys(PLAYED) };
})();

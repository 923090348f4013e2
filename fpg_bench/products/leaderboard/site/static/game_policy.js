/* Trained policies in the browser: a graph of ONNX operators for one game, run node by node in single precision.
   fpgPolicy.make({ nodes, weights, state, limit }) gives (observation, noise) => action, with a memory of its own.
   All is inside of one function, whose text runs in a worker, too. */
"use strict";
const fpgPolicyCode = () => {
  const count = (shape) => shape.reduce((product, size) => product * size, 1);
  let spent = 0, most = Infinity; // multiply-adds of this step, and the most that it may take

  /** Count multiply-adds before they are done. */
  function spend(number) {
    spent += number;
    if (!(spent <= most)) throw new Error(`The policy needs more than ${most.toLocaleString("en")} multiply-adds a step, the most that a submission may have.`);
  }

  function tensor(shape, data) {
    if (count(shape) !== data.length || shape.some((size) => size < 0)) throw new Error(`${data.length} numbers are not played as ${shape.join(" x ")}`);
    return { shape, data };
  }

  /** So many zeros of the kind of some numbers: single precision, or whole. */
  function zeros(like, number) {
    spend(number);
    return like instanceof Float32Array ? new Float32Array(number) : new Array(number).fill(0);
  }

  /** Weights as they were written: a tensor, little-endian numbers of 32 bits, or a list of integers. */
  function read({ shape, data, floats, integers }) {
    return tensor(shape, data ?? integers ?? new Float32Array(Uint8Array.from(atob(floats), (sign) => sign.charCodeAt(0)).buffer));
  }

  const sigmoid = (x) => 1 / (1 + Math.exp(-x));
  const softplus = (x) => Math.max(x, 0) + Math.log1p(Math.exp(-Math.abs(x)));
  const places = (axes, rank) => axes.map((axis) => (axis < 0 ? axis + rank : axis));
  /** An operator number by number; its function takes a number and the attributes. */
  const each = (of) => ([x], attributes) => tensor(x.shape, x.data.map((value) => of(value, attributes)));

  /** Abramowitz and Stegun, 7.1.26: within 1.5e-7. */
  function erf(x) {
    const t = 1 / (1 + 0.3275911 * Math.abs(x));
    return Math.sign(x) * (1 - t * (0.254829592 + t * (-0.284496736 + t * (1.421413741 + t * (-1.453152027 + t * 1.061405429)))) * Math.exp(-x * x));
  }

  function round(x) {
    const near = Math.round(x);
    return Math.abs(x % 1) === 0.5 ? 2 * Math.round(x / 2) : near;
  }

  /** Values at the places that `from` gives for each index of a new shape. */
  function gathered(shape, x, from) {
    const out = zeros(x.data, count(shape)), index = shape.map(() => 0);
    for (let i = 0; i < out.length; i++) {
      out[i] = x.data[from(index).reduce((sum, at, axis) => sum * x.shape[axis] + at, 0)];
      for (let axis = shape.length - 1; axis >= 0 && ++index[axis] === shape[axis]; axis--) index[axis] = 0;
    }
    return tensor(shape, out);
  }

  /** The shape of two tensors broadcast together. */
  function broadcast(a, b) {
    const rank = Math.max(a.length, b.length), size = (shape, axis) => shape[axis - rank + shape.length] ?? 1;
    return Array.from({ length: rank }, (_, axis) => (size(a, axis) === 1 ? size(b, axis) : size(a, axis)));
  }

  /** A tensor repeated along axes of size 1, to a shape. */
  function spread(x, shape) {
    if (x.data.length === count(shape)) return x.data;
    const begin = shape.length - x.shape.length;
    if (begin < 0 || x.shape.some((size, axis) => size !== 1 && size !== shape[begin + axis])) throw new Error(`${x.shape} is not played as ${shape}`);
    return gathered(shape, x, (index) => x.shape.map((size, axis) => (size === 1 ? 0 : index[begin + axis]))).data;
  }

  /** An operator on tensors, number by number, from the first to the last. */
  const pairwise = (of, after = (x) => x) => (inputs, attributes) => after(inputs.reduce((a, b) => {
    const shape = broadcast(a.shape, b.shape), [left, right] = [spread(a, shape), spread(b, shape)];
    spend(left.length);
    return tensor(shape, left.map((x, i) => of(x, right[i], attributes)));
  }), inputs.length);
  const add = pairwise((x, y) => x + y), multiply = pairwise((x, y) => x * y);
  const truth = (x) => tensor(x.shape, Array.from(x.data, Number));
  const divide = (inputs) => (inputs[0].data instanceof Float32Array ? pairwise((x, y) => x / y) : pairwise((x, y) => Math.trunc(x / y)))(inputs);
  const modulo = pairwise((x, y, { fmod = 0 }) => (fmod || !(x % y) || x < 0 === y < 0 ? x % y : (x % y) + y));

  function where([chosen, a, b]) {
    const shape = broadcast(broadcast(chosen.shape, a.shape), b.shape), [is, left, right] = [chosen, a, b].map((x) => spread(x, shape));
    return tensor(shape, left.map((x, i) => (is[i] ? x : right[i])));
  }

  function matmul([a, b], { transB = 0, alpha = 1 } = {}) {
    if (b.shape.length === 1) {
      const column = matmul([a, tensor([...b.shape, 1], b.data)]);
      return tensor(column.shape.slice(0, -1), column.data);
    }
    const [rows, inner] = a.shape.slice(-2), columns = b.shape.at(transB ? -2 : -1), wide = transB ? [columns, inner] : [inner, columns];
    const lead = broadcast(a.shape.slice(0, -2), b.shape.slice(0, -2)), batches = count(lead);
    const [left, right] = [spread(a, [...lead, rows, inner]), spread(b, [...lead, ...wide])];
    const out = zeros(left, batches * rows * columns);
    spend(out.length * inner);
    for (let i = 0; i < out.length; i++) {
      const j = i % columns, from = Math.floor(i / columns) * inner, batch = Math.floor(i / (rows * columns)) * inner * columns;
      const first = batch + (transB ? j * inner : j), step = transB ? 1 : columns;
      let sum = 0;
      for (let k = 0; k < inner; k++) sum += left[from + k] * right[first + k * step];
      out[i] = alpha * sum;
    }
    return tensor([...lead, rows, columns], out);
  }

  function gemm([a, b, c], { beta = 1, ...attributes }) {
    const product = matmul([a, b], attributes);
    return c ? add([product, tensor(c.shape, c.data.map((x) => beta * x))]) : product;
  }

  function clip([x, low, high]) {
    const least = low ? low.data[0] : -Infinity, largest = high ? high.data[0] : Infinity;
    return tensor(x.shape, x.data.map((value) => Math.min(Math.max(value, least), largest)));
  }

  function slice([x, starts, ends, axes, steps]) {
    const shape = [...x.shape], from = x.shape.map(() => 0), by = x.shape.map(() => 1);
    (axes ? places([...axes.data], shape.length) : [...starts.data.keys()]).forEach((axis, i) => {
      const size = x.shape[axis], bound = (at) => Math.max(0, Math.min(size, at < 0 ? at + size : at));
      by[axis] = steps ? steps.data[i] : 1;
      if (!(by[axis] > 0)) throw new Error("Slice: steps below 1 are not played");
      from[axis] = bound(starts.data[i]);
      shape[axis] = Math.max(0, Math.ceil((bound(ends.data[i]) - from[axis]) / by[axis]));
    });
    return gathered(shape, x, (index) => index.map((at, axis) => from[axis] + at * by[axis]));
  }

  function split([x, sizes], { axis = 0 }, outputs) {
    const [along] = places([axis], x.shape.length), part = Math.ceil(x.shape[along] / outputs.length);
    let begin = 0;
    return outputs.map((_, i) => {
      const size = sizes ? sizes.data[i] : Math.min(part, x.shape[along] - begin), first = begin;
      begin += size;
      return gathered(x.shape.with(along, size), x, (index) => index.with(along, first + index[along]));
    });
  }

  function concat(inputs, { axis }) {
    const [first] = inputs, [along] = places([axis], first.shape.length);
    const inner = count(first.shape.slice(along + 1)), outer = count(first.shape.slice(0, along));
    const shape = first.shape.with(along, inputs.reduce((sum, x) => sum + x.shape[along], 0)), out = zeros(first.data, count(shape));
    let at = 0;
    for (let i = 0; i < outer; i++)
      for (const x of inputs) for (let k = i * x.shape[along] * inner; k < (i + 1) * x.shape[along] * inner; k++) out[at++] = x.data[k];
    return tensor(shape, out);
  }

  function reshape([x, wanted], { allowzero = 0 }) {
    const shape = [...wanted.data].map((size, axis) => (size === 0 && !allowzero ? x.shape[axis] : size)), open = shape.indexOf(-1);
    if (open >= 0) shape[open] = x.data.length / -count(shape);
    return tensor(shape, x.data);
  }

  function transpose([x], { perm = [...x.shape.keys()].reverse() }) {
    return gathered(perm.map((axis) => x.shape[axis]), x, (index) => {
      const place = [];
      perm.forEach((axis, at) => (place[axis] = index[at]));
      return place;
    });
  }

  function gather([x, indices], { axis = 0 }) {
    const [along] = places([axis], x.shape.length), size = x.shape[along], rank = indices.shape.length;
    const chosen = (index) => indices.data[index.slice(along, along + rank).reduce((sum, at, i) => sum * indices.shape[i] + at, 0)];
    return gathered([...x.shape.slice(0, along), ...indices.shape, ...x.shape.slice(along + 1)], x, (index) => {
      const at = chosen(index);
      return [...index.slice(0, along), at < 0 ? at + size : at, ...index.slice(along + rank)];
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

  /** What a function gives for each line of numbers along an axis: as many again, or one. */
  function lines(x, axis, of) {
    const [along] = places([axis], x.shape.length), size = x.shape[along], inner = count(x.shape.slice(along + 1)), out = [];
    for (let i = 0; i < x.data.length / size; i++) {
      const first = Math.floor(i / inner) * size * inner + (i % inner);
      of(Array.from({ length: size }, (_, k) => x.data[first + k * inner])).forEach((value, k, all) => (out[Math.floor(i / inner) * all.length * inner + (i % inner) + k * inner] = value));
    }
    return out;
  }

  const extreme = (of) => ([x], { axis = 0, keepdims = 1 }) => {
    const [along] = places([axis], x.shape.length), shape = keepdims ? x.shape.with(along, 1) : x.shape.toSpliced(along, 1);
    return tensor(shape, lines(x, along, (values) => [values.reduce((best, value, k) => (of(value, values[best]) ? k : best), 0)]));
  };

  const shares = (values) => {
    const largest = values.reduce((a, b) => Math.max(a, b)), parts = values.map((value) => Math.exp(value - largest)), total = sum(parts);
    return parts.map((part) => part / total);
  };
  const softmax = (after) => ([x], { axis = -1 }) => tensor(x.shape, Float32Array.from(lines(x, axis, (values) => shares(values).map(after))));

  const sum = (values) => values.reduce((a, b) => a + b, 0);

  /** A reduction: a function of all numbers along some axes. */
  const reduced = (of) => ([x, given], { axes = given ? [...given.data] : [], keepdims = 1, noop_with_empty_axes: idle = 0 }) => {
    if (!axes.length && idle) return x;
    const gone = new Set(axes.length ? places(axes, x.shape.length) : x.shape.keys());
    const order = [...x.shape.keys()].sort((a, b) => gone.has(a) - gone.has(b) || a - b), turned = transpose([x], { perm: order });
    const kept = x.shape.filter((_, axis) => !gone.has(axis)), size = x.data.length / count(kept), out = zeros(x.data, count(kept));
    for (let i = 0; i < out.length; i++) out[i] = of(turned.data.slice(i * size, (i + 1) * size));
    return tensor(keepdims ? x.shape.map((one, axis) => (gone.has(axis) ? 1 : one)) : kept, out);
  };
  const mean = (values) => sum(values) / values.length, squares = (values) => values.reduce((total, x) => total + x * x, 0);
  const absolute = (values) => values.reduce((total, x) => total + Math.abs(x), 0);
  const largestOf = (values) => values.reduce((a, b) => Math.max(a, b));
  const sumOfExp = (values) => {
    const largest = largestOf(values);
    return largest + Math.log(sum(values.map((x) => Math.exp(x - largest))));
  };

  function flatten([x], { axis = 1 }) {
    const rows = count(x.shape.slice(0, places([axis], x.shape.length)[0]));
    return tensor([rows, x.data.length / rows], x.data);
  }

  function constant(_, { value, value_float: float, value_floats: floats, value_int: int, value_ints: ints }) {
    if (value) return read(value);
    return floats || float !== undefined ? tensor(floats ? [floats.length] : [], Float32Array.from(floats ?? [float])) : tensor(ints ? [ints.length] : [], ints ?? [int]);
  }

  function cast([x], { to }) {
    const KINDS = { 1: (data) => Float32Array.from(data), 6: (data) => Array.from(data, Math.trunc), 7: (data) => Array.from(data, Math.trunc), 9: (data) => Array.from(data, (value) => Number(value !== 0)) };
    return tensor(x.shape, KINDS[to](x.data));
  }

  function layerNormalization([x, scale, bias], { axis = -1, epsilon = 1e-5 }) {
    const size = count(x.shape.slice(places([axis], x.shape.length)[0])), out = zeros(x.data, x.data.length);
    for (let i = 0; i < out.length; i += size) {
      const row = x.data.slice(i, i + size), middle = mean(row), deviation = Math.sqrt(squares(row.map((value) => value - middle)) / size + epsilon);
      row.forEach((value, k) => (out[i + k] = (value - middle) / deviation));
    }
    const scaled = multiply([tensor(x.shape, out), scale]);
    return bias ? add([scaled, bias]) : scaled;
  }

  function batchNormalization([x, scale, bias, middle, variance], { epsilon = 1e-5 }) {
    const inner = count(x.shape.slice(2)), channels = x.shape[1] ?? 1;
    return tensor(x.shape, x.data.map((value, i) => {
      const c = Math.floor(i / inner) % channels;
      return (scale.data[c] * (value - middle.data[c])) / Math.sqrt(variance.data[c] + epsilon) + bias.data[c];
    }));
  }

  /** Sizes of an output of windows, and for each of its numbers the places in a channel; below 0: beside it. */
  function windows({ shape: [, , ...sizes] }, kernel, { pads = kernel.flatMap(() => [0, 0]), strides = kernel.map(() => 1), dilations = kernel.map(() => 1) }) {
    const made = kernel.map((size, i) => Math.floor((sizes[i] + pads[i] + pads[i + kernel.length] - dilations[i] * (size - 1) - 1) / strides[i]) + 1);
    spend(count(made) * count(kernel));
    const all = (shape) => Array.from({ length: count(shape) }, (_, i) => shape.map((size, axis) => Math.floor(i / count(shape.slice(axis + 1))) % size));
    const offsets = all(kernel), at = (out, offset) => offset.reduce((sum, k, axis) => {
      const place = out[axis] * strides[axis] - pads[axis] + k * dilations[axis];
      return place < 0 || place >= sizes[axis] ? -Infinity : sum * sizes[axis] + place;
    }, 0);
    return [made, all(made).map((out) => offsets.map((offset) => at(out, offset)))];
  }

  function conv([x, w, b], { group = 1, ...attributes }) {
    const [channels, deep, ...kernel] = w.shape, [made, all] = windows(x, kernel, attributes), inner = count(x.shape.slice(2)), size = count(kernel);
    const out = zeros(x.data, channels * all.length);
    spend(out.length * deep * size);
    for (let m = 0; m < channels; m++)
      all.forEach((window, i) => {
        let total = b ? b.data[m] : 0;
        for (let c = 0; c < deep; c++) {
          const from = (Math.floor((m * group) / channels) * deep + c) * inner, weight = (m * deep + c) * size;
          for (let k = 0; k < size; k++) if (window[k] >= 0) total += x.data[from + window[k]] * w.data[weight + k];
        }
        out[m * all.length + i] = total;
      });
    return tensor([1, channels, ...made], out);
  }

  const pool = (of) => ([x], { kernel_shape: kernel, ...attributes }) => {
    const [made, all] = windows(x, kernel, attributes), inner = count(x.shape.slice(2));
    spend(x.shape[1] * all.length * count(kernel));
    return tensor([1, x.shape[1], ...made], Float32Array.from({ length: x.shape[1] * all.length }, (_, i) => of(all[i % all.length].filter((at) => at >= 0).map((at) => x.data[Math.floor(i / all.length) * inner + at]))));
  };

  /** A recurrent layer of one row, forwards; `next` gives (inputs' sums, state's sums of a gate, h, c) => [h, c]. */
  const recurrent = (gates, next) => ([x, w, r, b, , h0, c0], { hidden_size: size, linear_before_reset: linear = 0 }) => {
    const [length, , wide] = x.shape, all = [], begin = (one) => (one ? Float32Array.from(one.data) : new Float32Array(size));
    let h = begin(h0), c = begin(c0);
    spend(length * gates * size * (wide + size));
    const product = (weights, row, values, from, number, bias) => {
      let total = b ? b.data[bias + row] : 0;
      for (let k = 0; k < number; k++) total += weights.data[row * number + k] * values[from + k];
      return total;
    };
    for (let t = 0; t < length; t++) {
      const given = (gate) => Float32Array.from({ length: size }, (_, k) => product(w, gate * size + k, x.data, t * wide, wide, 0));
      const kept = (gate, state = h) => Float32Array.from({ length: size }, (_, k) => product(r, gate * size + k, state, 0, size, gates * size));
      [h, c] = next(given, kept, h, c, linear);
      all.push(...h);
    }
    return [tensor([length, 1, 1, size], Float32Array.from(all)), tensor([1, 1, size], h), tensor([1, 1, size], c)];
  };
  const both = (given, kept, gate, of) => {
    const state = kept(gate);
    return given(gate).map((value, k) => of(value + state[k]));
  };

  function lstm(given, kept, _, c) {
    const [input, output, forget, cell] = [sigmoid, sigmoid, sigmoid, Math.tanh].map((of, gate) => both(given, kept, gate, of));
    const next = c.map((value, k) => forget[k] * value + input[k] * cell[k]);
    return [next.map((value, k) => output[k] * Math.tanh(value)), next];
  }

  function gru(given, kept, h, c, linear) {
    const [update, reset] = [0, 1].map((gate) => both(given, kept, gate, sigmoid)), state = kept(2, linear ? h : h.map((value, k) => reset[k] * value));
    const hidden = given(2).map((value, k) => Math.tanh(value + (linear ? reset[k] : 1) * state[k]));
    return [h.map((value, k) => (1 - update[k]) * hidden[k] + update[k] * value), c];
  }

  const PLAYED = {
    Gemm: gemm, MatMul: ([a, b]) => matmul([a, b]), Conv: conv, Clip: clip, Slice: slice, Split: split, Concat: concat, Reshape: reshape, Transpose: transpose, Gather: gather,
    Unsqueeze: unsqueeze, Squeeze: squeeze, Flatten: flatten, Constant: constant, Cast: cast, Identity: ([x]) => x, Where: where, ArgMax: extreme((x, y) => x > y), ArgMin: extreme((x, y) => x < y),
    Softmax: softmax((x) => x), LogSoftmax: softmax(Math.log), LayerNormalization: layerNormalization, BatchNormalization: batchNormalization,
    AveragePool: pool(mean), MaxPool: pool(largestOf), LSTM: recurrent(4, lstm), GRU: recurrent(3, gru), RNN: recurrent(1, (given, kept, h, c) => [both(given, kept, 0, Math.tanh), c]),
    Relu: each((x) => Math.max(0, x)), Sigmoid: each(sigmoid), Neg: each((x) => -x), Reciprocal: each((x) => 1 / x), Erf: each(erf), Round: each(round), Not: each((x) => Number(!x)),
    Elu: each((x, { alpha = 1 }) => (x < 0 ? alpha * Math.expm1(x) : x)), LeakyRelu: each((x, { alpha = 0.01 }) => (x < 0 ? alpha * x : x)),
    Celu: each((x, { alpha = 1 }) => Math.max(0, x) + Math.min(0, alpha * Math.expm1(x / alpha))), Softplus: each(softplus), Softsign: each((x) => x / (1 + Math.abs(x))),
    Selu: each((x, { alpha = 1.67326319217681884765625, gamma = 1.05070102214813232421875 }) => gamma * (x < 0 ? alpha * Math.expm1(x) : x)), Mish: each((x) => x * Math.tanh(softplus(x))),
    HardSigmoid: each((x, { alpha = 0.2, beta = 0.5 }) => Math.max(0, Math.min(1, alpha * x + beta))), HardSwish: each((x) => x * Math.max(0, Math.min(1, x / 6 + 0.5))),
    Gelu: each((x, { approximate = "none" }) => 0.5 * x * (1 + (approximate === "tanh" ? Math.tanh(Math.sqrt(2 / Math.PI) * (x + 0.044715 * x ** 3)) : erf(x / Math.SQRT2)))),
    Shrink: each((x, { bias = 0, lambd = 0.5 }) => (x < -lambd ? x + bias : x > lambd ? x - bias : 0)), ThresholdedRelu: each((x, { alpha = 1 }) => (x > alpha ? x : 0)),
    Sum: add, Add: add, Sub: pairwise((x, y) => x - y), Mul: multiply, Div: divide, Max: pairwise((x, y) => Math.max(x, y)), Min: pairwise((x, y) => Math.min(x, y)), Pow: pairwise((x, y) => x ** y), Mod: modulo,
    Mean: pairwise((x, y) => x + y, (x, number) => tensor(x.shape, x.data.map((value) => value / number))), PRelu: pairwise((x, slope) => (x < 0 ? slope * x : x)),
    Less: pairwise((x, y) => x < y, truth), LessOrEqual: pairwise((x, y) => x <= y, truth), Greater: pairwise((x, y) => x > y, truth), GreaterOrEqual: pairwise((x, y) => x >= y, truth),
    Equal: pairwise((x, y) => x === y, truth), And: pairwise((x, y) => x && y, truth), Or: pairwise((x, y) => x || y, truth), Xor: pairwise((x, y) => x !== y, truth),
    ReduceSum: reduced(sum), ReduceMean: reduced(mean), ReduceMax: reduced(largestOf), ReduceMin: reduced((values) => values.reduce((a, b) => Math.min(a, b))),
    ReduceProd: reduced((values) => values.reduce((a, b) => a * b, 1)), ReduceL1: reduced(absolute), ReduceL2: reduced((values) => Math.sqrt(squares(values))), ReduceSumSquare: reduced(squares),
    ReduceLogSum: reduced((values) => Math.log(sum(values))), ReduceLogSumExp: reduced(sumOfExp),
  };
  for (const name of ["Abs", "Acos", "Acosh", "Asin", "Asinh", "Atan", "Atanh", "Ceil", "Cos", "Cosh", "Exp", "Floor", "Log", "Sign", "Sin", "Sinh", "Sqrt", "Tan", "Tanh"]) PLAYED[name] = each(Math[name.toLowerCase()]);

  /** A player of one round; its memory begins empty. A limit is that of a submission, { most, weights }. */
  function make({ nodes, weights, state, limit }) {
    const held = Object.entries(weights).map(([name, weight]) => [name, read(weight)]);
    let memory = new Float32Array(state);
    return (seen, noise = []) => {
      const known = new Map([...held, ["observation", tensor([1, seen.length], Float32Array.from(seen))], ["state", tensor([1, state], memory)], ["noise", tensor([1, noise.length], Float32Array.from(noise))]]);
      [spent, most] = [0, limit?.most ?? Infinity];
      for (const { op, inputs, outputs, attributes } of nodes) {
        const given = inputs.map((name) => known.get(name)), values = [PLAYED[op](given, attributes, outputs)].flat();
        values.forEach((one, i) => known.set(outputs[i], one));
        if (limit) spend((limit.weights[op] ?? 1) * [...given, ...values].reduce((total, x) => total + (x?.data.length ?? 0), 0));
      }
      if (state) memory = known.get("next_state").data;
      return Array.from(known.get("action").data);
    };
  }

  return { make, OPERATORS: Object.keys(PLAYED) };
};
const fpgPolicy = fpgPolicyCode();

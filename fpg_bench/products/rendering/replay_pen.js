/** Drawing on a canvas: its size, lines, texts, and labels that keep clear of each other. */
const fpgPen = (() => {
  "use strict";

  /** A canvas' pen, its size in pixels of the page; what was drawn is gone. */
  function prepare(canvas) {
    const ratio = window.devicePixelRatio || 1;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    pen.font = '11.5px system-ui, "DejaVu Sans", sans-serif';
    pen.lineJoin = "round";
    return { pen, width, height };
  }

  function stroke(pen, points, colour, width = 1, dash = [], alpha = 1) {
    pen.globalAlpha = alpha;
    pen.strokeStyle = colour;
    pen.lineWidth = width;
    pen.setLineDash(dash);
    pen.beginPath();
    points.forEach(([x, y], i) => (i ? pen.lineTo(x, y) : pen.moveTo(x, y)));
    pen.stroke();
    pen.setLineDash([]);
    pen.globalAlpha = 1;
  }

  const font = (bold) => (bold ? "600 " : "") + '12px system-ui, "DejaVu Sans", sans-serif';

  function note(pen, text, [x, y], colours, colour, bold = false, align = "center") {
    pen.font = font(bold);
    pen.textAlign = align;
    pen.textBaseline = "middle";
    pen.lineWidth = 3;
    pen.strokeStyle = colours.panel;
    pen.strokeText(text, x, y);
    pen.fillStyle = colour;
    pen.fillText(text, x, y);
  }

  /** What jamming of a kind covers between two ends of an axis, as [from, to] in MHz: one piece, or one for each tooth. */
  function footprint({ half_width_mhz: half, spacing_mhz: spacing }, centre, low, high) {
    const first = spacing ? centre - spacing * Math.ceil((centre - low) / spacing) : centre, pieces = [];
    for (let tooth = first; tooth - half < high; tooth += spacing || Infinity)
      if (tooth + half > low) pieces.push([Math.max(low, tooth - half), Math.min(high, tooth + half)]);
    return pieces;
  }

  const HEIGHT = 15; // of a line of text
  const meet = (a, b) => a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;
  const around = ([x, y], width, height) => ({ left: x - width / 2, right: x + width / 2, top: y - height / 2, bottom: y + height / 2 });

  /** Labels that are drawn at last, each as near to its place as leaves it inside and clear of all others. */
  function labels(pen, width, height, colours) {
    const taken = [], wanted = [], written = [];

    /** Keep a place of this many pixels free, for a mark. */
    function keep(place, size) {
      taken.push(around(place, size, size));
    }

    function add(text, place, colour, bold = true) {
      wanted.push({ text, place, colour, bold });
    }

    /** Places around a point, nearest first; [across, down] in half sizes of the text and pixels. */
    function* tries([x, y], wide) {
      for (const gap of [12, 26, 42, 60])
        for (const [across, down] of [[0, -1], [0, 1], [1, 0], [-1, 0], [1, -1], [-1, -1], [1, 1], [-1, 1]])
          yield [x + across * (wide / 2 + gap * (down ? 0.3 : 0.7)), y + down * gap * 1.1];
    }

    function free(box) {
      return box.left >= 2 && box.right <= width - 2 && box.top >= 2 && box.bottom <= height - 2 && !taken.some((other) => meet(box, other));
    }

    /** Write them in the order in which they were added; one that finds no place is left out. */
    function write() {
      for (const { text, place, colour, bold } of wanted) {
        pen.font = font(bold);
        const wide = pen.measureText(text).width + 4;
        for (const spot of tries(place, wide)) {
          const box = around(spot, wide, HEIGHT);
          if (!free(box)) continue;
          taken.push(box);
          written.push({ text, ...box });
          note(pen, text, spot, colours, colour, bold);
          break;
        }
      }
      return written;
    }

    return { keep, add, write };
  }

  function readColours() {
    const style = getComputedStyle(document.documentElement);
    const names = ["page", "panel", "ground", "ink", "grey", "line", "ally", "opponent", "spreading", "veil"];
    return Object.fromEntries(names.map((name) => [name, style.getPropertyValue("--" + name).trim()]));
  }

  return { prepare, stroke, note, footprint, labels, readColours };
})();

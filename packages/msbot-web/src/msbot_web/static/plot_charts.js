// Draws curves with uPlot. Curves of one unit share an axis; up to two units share a chart, else each has one of its own,
// and all charts have the same axis of time.
const msbotCharts = (host, words, number, hour) => {
  const DASHES = { solid: [], dashed: [7, 4], dotted: [2, 3] };
  // Steps of the axis of time, milliseconds; all of them divide a day, so that labels are round on the clock.
  const SECOND = 1000, MINUTE = 60 * SECOND, HOUR = 60 * MINUTE, DAY = 24 * HOUR;
  const TIMES = [10, 20, 50, 100, 200, 500, SECOND, 2 * SECOND, 5 * SECOND, 10 * SECOND, 15 * SECOND, 30 * SECOND, MINUTE,
                 2 * MINUTE, 5 * MINUTE, 10 * MINUTE, 15 * MINUTE, 30 * MINUTE, HOUR, 2 * HOUR, 3 * HOUR, 6 * HOUR, 12 * HOUR,
                 DAY, 2 * DAY, 5 * DAY, 10 * DAY];
  const TOP = 26, TIME_HEIGHT = 26, GAP = 10, NARROW = 600, PICTURE = 2, NAME_WIDTH = 300, FINE_MS = 5000;
  let charts = [], layout = "";

  const colour = (name) => getComputedStyle(document.body).getPropertyValue(name).trim();
  const unitsOf = (curves) => [...new Set(curves.map((curve) => curve.unit))];
  const isNarrow = () => host.clientWidth < NARROW;

  // The charts: which curves are in each, and its units.
  function groups(curves) {
    const units = unitsOf(curves);
    if (units.length <= 2) return [{ units, places: curves.map((_, place) => place) }];
    return units.map((unit) => ({
      units: [unit], places: curves.flatMap((curve, place) => (curve.unit === unit ? [place] : [])),
    }));
  }

  // What uPlot draws for a curve. A value that is no number leaves a gap; a setting holds until it is changed.
  const line = (holds) => (chart, place) => {
    const stroke = new Path2D();
    uPlot.orient(chart, place, (_series, times, values, x, y, _x, _y, left, top, width, height) => {
      const wide = width / (x.max - x.min), high = height / (y.max - y.min);
      const right = left - x.min * wide, bottom = top + height + y.min * high;
      let before = NaN;
      for (let index = 0; index < times.length; index += 1) {
        const value = values[index];
        if (value === null) {
          before = NaN;
          continue;
        }
        const across = right + times[index] * wide, down = bottom - value * high;
        if (before !== before) stroke.moveTo(across, down);
        else {
          if (holds) stroke.lineTo(across, before);
          stroke.lineTo(across, down);
        }
        before = down;
      }
    });
    return { stroke, fill: null, clip: null, band: null, gaps: null, flags: 0 };
  };

  // A range with some room above and below, and round ends, so that it seldom changes while the window moves.
  const range = (_chart, least, most) => (least === null ? [0, 1] : uPlot.rangeNum(least, most, 0.1, true));

  // One chart; `size` is 2 for a picture that is twice as large.
  function chart(parent, curves, { units, places }, box, window_, data, size) {
    const ink = colour("--soft"), grid = { stroke: colour("--line"), width: size }, family = getComputedStyle(host).fontFamily;
    const font = `${12 * size}px ${family}`, side = (isNarrow() ? 46 : 64) * size;
    const axis = { stroke: ink, font, grid, ticks: { ...grid, size: 4 * size }, gap: 4 * size };
    const made = new uPlot({
      mode: 2, width: box.width * size, height: box.height * size, legend: { show: false }, cursor: { show: false },
      padding: [TOP * size, units.length === 2 ? 0 : 16 * size, 0, 0], pxAlign: 0,
      scales: {
        x: { time: false, auto: false, min: window_[0], max: window_[1], range: (_chart, least, most) => [least, most] },
        ...Object.fromEntries(units.map((_, place) => [`y${place}`, { auto: true, range }])),
      },
      axes: [
        { ...axis, scale: "x", side: 2, incrs: TIMES, space: 90 * size, size: (box.hasTime ? TIME_HEIGHT : GAP) * size,
          values: (one, splits) => (box.hasTime ? splits.map((at) => hour(at, one.scales.x.max - one.scales.x.min < FINE_MS)) : splits.map(() => null)) },
        ...units.map((_, place) => ({
          ...axis, scale: `y${place}`, side: place ? 1 : 3, size: side, space: 36 * size, values: (_chart, splits) => splits.map(number),
          grid: place ? { show: false } : grid,
        })),
      ],
      series: [null, ...places.map((place) => ({
        label: curves[place].name, stroke: curves[place].colour, width: 1.8 * size, points: { show: false },
        dash: DASHES[curves[place].dash].map((length) => length * size), paths: line(curves[place].holds),
        facets: [{ scale: "x", auto: false, sorted: 1 }, { scale: `y${units.indexOf(curves[place].unit)}`, auto: true, sorted: 0 }],
      }))],
      hooks: { draw: [(one) => name(one, units, ink, font, size)] },
    }, given(places, data), parent);
    return { made, places };
  }

  // The units, above their axes.
  function name(chart, units, ink, font, size) {
    const { ctx, bbox } = chart, ratio = chart.ctx.canvas.width / chart.width;
    ctx.save();
    ctx.font = font.replace(/^\d+/, (pixels) => pixels * ratio);
    ctx.fillStyle = ink;
    ctx.textBaseline = "bottom";
    units.forEach((unit, place) => {
      ctx.textAlign = place ? "right" : "left";
      const at = place ? chart.ctx.canvas.width - 4 * size * ratio : 4 * size * ratio;
      ctx.fillText(unit ? `[${unit}]` : words.no_unit, at, bbox.top - 8 * size * ratio);
    });
    ctx.restore();
  }

  const given = (places, data) => [null, ...places.map((place) => data[place])];

  function boxes(found) {
    const each = found.length === 1 ? (isNarrow() ? 250 : 340) : 165;
    return found.map((_, place) => {
      const hasTime = place === found.length - 1;
      return { width: host.clientWidth, height: TOP + each + (hasTime ? TIME_HEIGHT : GAP), hasTime };
    });
  }

  // Draw; `data` has for each curve its times and its values. The charts are made anew only when something else is shown.
  function draw(curves, begin, end, data) {
    const looks = JSON.stringify([curves.map((one) => [one.name, one.unit]), host.clientWidth, colour("--ink")]);
    if (looks !== layout) {
      layout = looks;
      const found = groups(curves), size = boxes(found), old = charts;
      charts = host.clientWidth && curves.length ? found.map((group, place) => chart(host, curves, group, size[place], [begin, end], data, 1)) : [];
      for (const one of old) one.made.destroy();
      return;
    }
    for (const { made, places } of charts) {
      made.batch(() => {
        made.setData(given(places, data), false);
        made.setScale("x", { min: begin, max: end });
      });
    }
  }

  // The box in which the curves are, in pixels of the host.
  function area() {
    if (!charts.length) return { left: 0, width: 1 };
    const { over } = charts[0].made;
    return { left: over.offsetLeft, width: over.offsetWidth || 1 };
  }

  // A picture of the charts, with the names of the curves below; twice as large as on the screen.
  function picture(curves, begin, end, data) {
    const away = document.createElement("div"), found = groups(curves), size = boxes(found);
    const made = found.map((group, place) => chart(away, curves, group, size[place], [begin, end], data, PICTURE).made);
    for (const one of made) one.batch(() => one.setScale("x", { min: begin, max: end }));
    const canvases = made.map((one) => one.ctx.canvas), ratio = canvases[0].width / (size[0].width * PICTURE), unit = PICTURE * ratio;
    const whole = document.createElement("canvas"), pen = whole.getContext("2d");
    const row = 20 * unit, high = canvases.reduce((sum, one) => sum + one.height, 0);
    const columns = Math.max(Math.floor(canvases[0].width / (NAME_WIDTH * unit)), 1), rows = Math.ceil(curves.length / columns);
    whole.width = canvases[0].width;
    whole.height = high + (rows + 1) * row;
    pen.fillStyle = colour("--card");
    pen.fillRect(0, 0, whole.width, whole.height);
    let top = 0;
    for (const canvas of canvases) {
      pen.drawImage(canvas, 0, top);
      top += canvas.height;
    }
    pen.font = `${12 * unit}px ${getComputedStyle(host).fontFamily}`;
    pen.textBaseline = "middle";
    curves.forEach((curve, place) => {
      const left = Math.floor(place / rows) * whole.width / columns, middle = top + (place % rows + 0.8) * row;
      pen.strokeStyle = curve.colour;
      pen.lineWidth = 2.5 * unit;
      pen.setLineDash(DASHES[curve.dash].map((length) => length * unit));
      pen.beginPath();
      pen.moveTo(left + 12 * unit, middle);
      pen.lineTo(left + 40 * unit, middle);
      pen.stroke();
      pen.fillStyle = colour("--ink");
      pen.fillText(curve.unit ? `${curve.name} [${curve.unit}]` : curve.name, left + 48 * unit, middle);
    });
    for (const one of made) one.destroy();
    return whole;
  }

  return { draw, area, picture };
};

// Curves of a page: the robot sends numbers as they come, the browser draws them ten times a second.
// Times are milliseconds since 1970 on the clock of the robot's computer, so that all who look see the same hour.
const msbotPlots = (() => {
  const DRAW_MS = 100, BUSY = 0.5, QUIET_MS = 350, MOST_KEPT = 6000, LEAST_SPAN_MS = 200, PAN = 0.25, STEP = 0.01, LATELY = 5;
  const VIEWS = "msbot_plots_views";
  // Okabe and Ito's, which people tell apart who see few colours; the black one is that of letters.
  const COLOURS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#8C6BB1", "#7F7F7F"];
  const DASHES = ["solid", "dashed", "dotted"];
  let chart = null, host = null, curves = [], isLive = true, span = 60000, from = 0, to = 0, clockAt = 0;
  let cursor = null, timer = null, quiet = null, frames = 0, layout = "", words = {}, dragged = null, isShown = true, lately = [];

  const now = () => clockAt + performance.now();
  const colour = (name) => getComputedStyle(document.body).getPropertyValue(name).trim();
  let format = null;
  const number = (value) => {
    format ||= new Intl.NumberFormat(document.documentElement.lang, { maximumSignificantDigits: 5 });
    return format.format(value);
  };
  const hour = (at, digits) => new Date(at).toISOString().slice(11, digits ? 23 : 19);

  function begin(setup) {
    words = setup.words;
    window.msbotPlotsFrames = () => frames;
    host = document.getElementById(setup.host);
    const wait = () => {
      const element = getElement(setup.chart);
      if (!element || !element.chart) return setTimeout(wait, 30);
      chart = element.chart;
      listen();
      emitEvent("plots_views", views());
      show(setup);
      tick();
    };
    wait();
  }

  // Other curves, or another window of time.
  function show(setup) {
    clockAt = setup.now - performance.now();
    isLive = setup.live;
    span = setup.span;
    from = setup.from;
    to = setup.to;
    curves = setup.curves.map((curve, place) => ({
      ...curve, colour: COLOURS[place % COLOURS.length], dash: DASHES[Math.floor(place / COLOURS.length) % DASHES.length],
    }));
    layout = "";
    const at = new URL(location.href).searchParams.get("at");
    history.replaceState(history.state, "", at && !isLive ? `${setup.address}&at=${at}` : setup.address);
    draw();
  }

  // What has come since: for each curve (by its place) its new points.
  function add(news) {
    for (const [place, points] of news) {
      const curve = curves[place];
      if (!curve) continue;
      for (const point of points) curve.points.push(point);
      const oldest = now() - span - 1000;
      let gone = 0;
      while (gone < curve.points.length - 1 && curve.points[gone + 1][0] < oldest) gone += 1;
      if (gone) curve.points.splice(0, gone);
      if (curve.points.length > MOST_KEPT) curve.points = thinned(curve.points, MOST_KEPT / 2);
    }
  }

  // Ten times a second; where drawing takes long, seldom enough to leave half of the time to all else. What counts is
  // the median of the latest pictures: that other programs took the processor during one of them says nothing.
  function tick() {
    let took = 0, usual = 0;
    if (isLive && isShown && !document.hidden && document.contains(host)) {
      const began = performance.now();
      draw();
      took = performance.now() - began;
      lately = [...lately.slice(1 - LATELY), took];
      usual = [...lately].sort((one, other) => one - other)[lately.length >> 1];
    }
    clearTimeout(timer);
    timer = setTimeout(tick, Math.max(DRAW_MS - took, usual / BUSY - took, 10));
  }

  // Of each step of time the least and the greatest value; the steps stand still while the window moves.
  function thinned(points, most) {
    if (points.length <= most) return points;
    const step = (points[points.length - 1][0] - points[0][0]) / (most / 2) || 1;
    const kept = [];
    let place = 0;
    while (place < points.length) {
      const end = (Math.floor(points[place][0] / step) + 1) * step;
      let least = points[place], most = points[place];
      for (; place < points.length && points[place][0] < end; place += 1) {
        if (points[place][1] < least[1]) least = points[place];
        if (points[place][1] > most[1]) most = points[place];
      }
      if (least === most) kept.push(least);
      else kept.push(...(least[0] < most[0] ? [least, most] : [most, least]));
    }
    return kept;
  }

  function window_() {
    return isLive ? [now() - span, now()] : [from, to];
  }

  function shown(curve, begin, end, width) {
    const points = curve.points;
    let first = 0, last = points.length;
    while (first < points.length - 1 && points[first + 1][0] < begin) first += 1;
    while (last > first && points[last - 1][0] > end) last -= 1;
    const data = thinned(points.slice(first, Math.min(last + 1, points.length)), width);
    // A setting holds until it is changed.
    if (curve.holds && data.length && data[data.length - 1][0] < end) return [...data, [end, data[data.length - 1][1]]];
    return data;
  }

  function draw() {
    if (!chart) return;
    const [begin, end] = window_();
    const units = [...new Set(curves.map((curve) => curve.unit))];
    const isTwo = units.length <= 2, panels = isTwo ? 1 : units.length;
    const isNarrow = host.clientWidth < 600;
    const made = JSON.stringify([curves.map((one) => [one.name, one.unit]), isNarrow, colour("--ink")]);
    const data = curves.map((curve) => ({ data: shown(curve, begin, end, host.clientWidth) }));
    frames += 1;
    if (made === layout) {
      chart.setOption({ xAxis: Array(panels).fill({ min: begin, max: end }), series: data });
    } else {
      layout = made;
      build(units, isTwo, panels, isNarrow, begin, end, data);
    }
    chart.getZr().flush(); // now, so that it is known how long it takes
    tell(begin, end);
  }

  function build(units, isTwo, panels, isNarrow, begin, end, data) {
    const each = panels === 1 ? (isNarrow ? 250 : 340) : 165, gap = 34, top = 30;
    host.style.height = `${top + panels * (each + gap)}px`;
    chart.resize();
    const ink = colour("--soft"), line = colour("--line");
    const left = isNarrow ? 46 : 64, right = isTwo && units.length === 2 ? left : 16;
    const axis = { axisLine: { show: true, lineStyle: { color: line } }, axisLabel: { color: ink, hideOverlap: true },
                   splitLine: { lineStyle: { color: line } } };
    chart.setOption({
      animation: false, useUTC: true, textStyle: { fontFamily: "inherit" },
      grid: Array.from({ length: panels }, (_, place) => ({ left, right, top: top + place * (each + gap), height: each - 4 })),
      xAxis: Array.from({ length: panels }, (_, place) => ({
        ...axis, type: "time", gridIndex: place, min: begin, max: end, splitNumber: isNarrow ? 3 : 8,
        axisLabel: { ...axis.axisLabel, show: place === panels - 1, formatter: (at) => hour(at, end - begin < 5000) },
      })),
      yAxis: units.map((unit, place) => ({
        ...axis, type: "value", scale: true, gridIndex: isTwo ? 0 : place, position: isTwo && place === 1 ? "right" : "left",
        name: unit ? `[${unit}]` : words.no_unit, nameTextStyle: { color: ink, align: isTwo && place === 1 ? "right" : "left" },
        nameLocation: "end", nameGap: 8, splitLine: { show: !(isTwo && place === 1), lineStyle: { color: line } },
        axisLabel: { ...axis.axisLabel, formatter: number },
      })),
      series: curves.map((curve, place) => ({
        type: "line", name: curve.name, showSymbol: false, silent: true, step: curve.holds ? "end" : false,
        xAxisIndex: isTwo ? 0 : units.indexOf(curve.unit), yAxisIndex: units.indexOf(curve.unit),
        lineStyle: { color: curve.colour, width: 1.8, type: curve.dash }, itemStyle: { color: curve.colour }, ...data[place],
      })),
    }, { notMerge: true });
  }

  // The value of a curve at a time: that of the last point before it.
  function valueAt(curve, at) {
    let low = 0, high = curve.points.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (curve.points[middle][0] <= at) low = middle + 1;
      else high = middle;
    }
    return low ? curve.points[low - 1][1] : null;
  }

  function tell(begin, end) {
    const line = host.parentElement.querySelector(".plot-cursor");
    const at = cursor === null ? end : begin + cursor * (end - begin);
    const place = cursor === null ? NaN : chart.convertToPixel({ xAxisIndex: 0 }, at);
    line.style.display = Number.isFinite(place) ? "block" : "none";
    if (Number.isFinite(place)) line.style.left = `${place}px`;
    const head = document.querySelector("#ms-plot-figures th.at");
    if (head) head.textContent = cursor === null ? words.latest : hour(at, true);
    for (const row of document.querySelectorAll("#ms-plot-figures tr[data-place]")) {
      const curve = curves[+row.dataset.place];
      if (!curve) continue;
      const value = valueAt(curve, at), cell = row.querySelector("td.at"), key = row.querySelector(".key");
      const text = value === null ? "–" : number(value);
      if (cell.textContent !== text) cell.textContent = text; // what stays the same need not be laid out again
      const look = `3px ${curve.dash} ${curve.colour}`;
      if (key.dataset.look !== look) key.style.borderTop = key.dataset.look = look;
    }
  }

  // Look at another window: it is drawn from what is here at once, and asked for when the person has come to rest.
  function look(begin, end) {
    const width = Math.max(end - begin, LEAST_SPAN_MS), latest = now();
    isLive = false;
    to = Math.min(end, latest);
    from = to - width;
    draw();
    clearTimeout(quiet);
    quiet = setTimeout(() => emitEvent("plots_window", { from, to }), QUIET_MS);
  }

  function zoom(factor, share = 0.5) {
    const [begin, end] = window_();
    const middle = begin + share * (end - begin);
    look(middle - (middle - begin) * factor, middle + (end - middle) * factor);
  }

  function pan(share) {
    const [begin, end] = window_();
    look(begin + share * (end - begin), end + share * (end - begin));
  }

  function pause() {
    const [begin, end] = window_();
    look(begin, end);
  }

  function share(event) {
    const box = host.getBoundingClientRect();
    const left = chart.convertToPixel({ xAxisIndex: 0 }, window_()[0]), right = chart.convertToPixel({ xAxisIndex: 0 }, window_()[1]);
    return Math.min(Math.max((event.clientX - box.left - left) / (right - left), 0), 1);
  }

  function listen() {
    const area = host.parentElement;
    area.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && !event.shiftKey && Math.abs(event.deltaY) < 1) return;
      event.preventDefault();
      if (event.shiftKey) pan(Math.sign(event.deltaY || event.deltaX) * PAN / 2);
      else zoom(event.deltaY < 0 ? 0.8 : 1.25, share(event));
    }, { passive: false });
    area.addEventListener("pointerdown", (event) => {
      if (event.button === 0) dragged = { x: event.clientX, window: window_(), moved: false };
    });
    addEventListener("pointerup", () => { dragged = null; });
    addEventListener("pointercancel", () => { dragged = null; });
    area.addEventListener("pointermove", (event) => {
      if (dragged && Math.abs(event.clientX - dragged.x) > 6) dragged.moved = true;
      if (dragged && dragged.moved) {
        const [begin, end] = dragged.window;
        const by = (dragged.x - event.clientX) / host.clientWidth * (end - begin);
        look(begin + by, end + by);
      }
      cursor = share(event);
      if (!isLive) tell(...window_());
    });
    area.addEventListener("pointerleave", (event) => {
      if (event.pointerType !== "mouse") return;
      cursor = null;
      if (!isLive) tell(...window_());
    });
    area.addEventListener("keydown", (event) => {
      const deeds = {
        "+": () => zoom(0.5), "-": () => zoom(2), " ": () => (isLive ? pause() : emitEvent("plots_live")), Home: () => emitEvent("plots_live"),
        ArrowLeft: () => (event.shiftKey ? pan(-PAN) : move(-STEP)), ArrowRight: () => (event.shiftKey ? pan(PAN) : move(STEP)),
      };
      if (!deeds[event.key] || event.ctrlKey || event.altKey || event.metaKey) return;
      event.preventDefault();
      deeds[event.key]();
    });
    document.addEventListener("visibilitychange", () => {
      isShown = !document.hidden;
      emitEvent("plots_seen", isShown);
    });
  }

  function move(by) {
    cursor = Math.min(Math.max((cursor === null ? 1 : cursor) + by, 0), 1);
    if (!isLive) tell(...window_());
  }

  function save() {
    const link = document.createElement("a");
    link.href = chart.getDataURL({ type: "png", pixelRatio: 2, backgroundColor: colour("--card") });
    link.download = "plots.png";
    link.click();
  }

  function views() {
    try {
      return JSON.parse(localStorage.getItem(VIEWS)) || {};
    } catch {
      return {};
    }
  }

  function keep(name, address) {
    const all = views();
    if (address) all[name] = address;
    else delete all[name];
    localStorage.setItem(VIEWS, JSON.stringify(all));
    emitEvent("plots_views", all);
  }

  return { begin, show, add, zoom, pan, pause, save, keep };
})();

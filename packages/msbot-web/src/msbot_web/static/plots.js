// Curves of a page: the robot sends numbers as they come, the browser draws them ten times a second.
// Times are milliseconds since 1970 on the clock of the robot's computer, so that all who look see the same hour.
const msbotPlots = (() => {
  const DRAW_MS = 100, BUSY = 0.5, QUIET_MS = 350, MOST_KEPT = 6000, LEAST_SPAN_MS = 200, PAN = 0.25, STEP = 0.01, LATELY = 5, TELL_MS = 250;
  // Whoever does not want motion sees a new picture twice a second.
  const calm = matchMedia("(prefers-reduced-motion: reduce)"), CALM_MS = 500;
  const VIEWS = "msbot_plots_views";
  // Okabe and Ito's, which people tell apart who see few colours; the black one is that of letters.
  const COLOURS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#8C6BB1", "#7F7F7F"];
  const DASHES = ["solid", "dashed", "dotted"];
  let charts = null, host = null, curves = [], isLive = true, span = 60000, from = 0, to = 0, clockAt = 0;
  let cursor = null, timer = null, quiet = null, frames = 0, words = {}, dragged = null, isShown = true;
  let due = 0, lately = [], toldAt = 0;

  const now = () => clockAt + performance.now();
  let format = null;
  const number = (value) => {
    format ||= new Intl.NumberFormat(document.documentElement.lang, { maximumSignificantDigits: 5 });
    return format.format(value);
  };
  const hour = (at, isFine) => new Date(at).toISOString().slice(11, isFine ? 23 : 19);

  function begin(setup) {
    words = setup.words;
    window.msbotPlotsFrames = () => frames;
    const wait = () => {
      host = document.getElementById(setup.host);
      if (!host || !window.uPlot) return setTimeout(wait, 30);
      charts = msbotCharts(host, words, number, hour);
      listen();
      reachable(document.querySelector(".plot-choice"));
      // The server sends the table anew each second, without the values at the cursor.
      new MutationObserver(() => tell(...window_())).observe(document.getElementById("ms-plot-figures"), { childList: true });
      emitEvent("plots_views", views());
      show(setup);
      due = performance.now();
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
      if (curve.points.length > MOST_KEPT) {
        curve.points = thinned(curve.points, MOST_KEPT / 2, curve.points[curve.points.length - 1][0] - curve.points[0][0]);
      }
    }
  }

  // Ten times a second, or as calm wants it; where drawing takes long, seldom enough to leave half of the time to all else. What counts is
  // the median of the latest pictures: that other programs took the processor during one of them says nothing.
  function tick() {
    const began = performance.now();
    let usual = 0;
    if (isLive && isShown && !document.hidden && document.contains(host)) {
      draw();
      lately = [...lately.slice(1 - LATELY), performance.now() - began];
      usual = [...lately].sort((one, other) => one - other)[lately.length >> 1];
    }
    const ended = performance.now();
    due = Math.max(due + (calm.matches ? CALM_MS : DRAW_MS), began + usual / BUSY, ended + 10);
    clearTimeout(timer);
    timer = setTimeout(tick, due - ended);
  }

  // Of each step of time the least and the greatest value; the steps stand still while the window moves.
  function thinned(points, most, width) {
    if (points.length <= most) return points;
    const step = width / (most / 2) || 1;
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

  // How many points of a curve are not later than a time.
  function until(points, at) {
    let low = 0, high = points.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (points[middle][0] <= at) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  // The times and values of a curve in a window, with one point beyond each side.
  function shown(curve, begin, end) {
    const { points } = curve;
    const found = thinned(points.slice(Math.max(until(points, begin) - 1, 0), until(points, end) + 1), host.clientWidth, end - begin);
    const times = [], values = [];
    for (const [at, value] of found) {
      times.push(at);
      values.push(Number.isFinite(value) ? value : null);
    }
    // A setting holds until it is changed.
    if (curve.holds && times.length && times[times.length - 1] < end) {
      times.push(end);
      values.push(values[values.length - 1]);
    }
    return [times, values];
  }

  function draw() {
    if (!charts) return;
    const [begin, end] = window_();
    charts.draw(curves, begin, end, curves.map((curve) => shown(curve, begin, end)));
    frames += 1;
    // Nobody reads numbers that change ten times a second.
    if (!isLive || performance.now() - toldAt >= TELL_MS) tell(begin, end);
  }

  // The value of a curve at a time: that of the last point before it.
  function valueAt(curve, at) {
    const before = until(curve.points, at);
    return before ? curve.points[before - 1][1] : null;
  }

  function tell(begin, end) {
    toldAt = performance.now();
    const mark = host.parentElement.querySelector(".plot-cursor"), area = charts.area();
    const at = cursor === null ? end : begin + cursor * (end - begin);
    mark.style.display = cursor === null ? "none" : "block";
    if (cursor !== null) mark.style.left = `${area.left + cursor * area.width}px`;
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
    const { left, width } = charts.area();
    return Math.min(Math.max((event.clientX - host.getBoundingClientRect().left - left) / width, 0), 1);
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
      tell(...window_());
    });
    area.addEventListener("pointerleave", (event) => {
      if (event.pointerType !== "mouse") return;
      cursor = null;
      tell(...window_());
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
    new ResizeObserver(draw).observe(host);
    const isDark = () => document.body.classList.contains("body--dark");
    let wasDark = isDark(); // the class is written again and again
    new MutationObserver(() => {
      if (isDark() === wasDark) return;
      wasDark = isDark();
      draw();
    }).observe(document.body, { attributes: true, attributeFilter: ["class"] });
    document.addEventListener("visibilitychange", () => {
      isShown = !document.hidden;
      emitEvent("plots_seen", isShown);
    });
  }

  // The crosses of chosen curves: Quasar lets Tab pass them unless their field has the focus, and names them all alike.
  function reachable(choice) {
    const mend = () => {
      for (const cross of choice.querySelectorAll(".q-chip__icon--remove")) {
        const name = words.remove.replace("{name}", cross.parentElement.querySelector(".q-chip__content").textContent);
        if (cross.tabIndex !== 0) cross.tabIndex = 0;
        if (cross.getAttribute("aria-label") !== name) cross.setAttribute("aria-label", name);
      }
    };
    mend();
    new MutationObserver(mend).observe(choice, { childList: true, subtree: true, characterData: true, attributes: true, attributeFilter: ["tabindex", "aria-label"] });
  }

  function move(by) {
    cursor = Math.min(Math.max((cursor === null ? 1 : cursor) + by, 0), 1);
    tell(...window_());
  }

  function save() {
    const link = document.createElement("a");
    const [begin, end] = window_();
    link.href = charts.picture(curves, begin, end, curves.map((curve) => shown(curve, begin, end))).toDataURL("image/png");
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

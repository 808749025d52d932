// The lesson beside the robot: what its step names is framed on the page, and code is copied.
const msbotLesson = (() => {
  const LOOK_MS = 400, MOST = 4, HEAD_PX = 115, PHONE_PX = 600, WIDE_PX = 1500;
  let wanted = null, isNew = false;

  const shown = (one) => one.getClientRects().length > 0;
  const outside = (one) => !one.closest(".ms-lesson");
  const wordsOf = (one) => {
    const text = [...one.querySelectorAll(".plug-words, .q-btn__content, .q-tab__label")].map((each) => each.innerText)[0];
    return (text === undefined ? one.innerText || "" : text).replace(/^[a-z_]+\n/, "").trim().toLowerCase();
  };

  // Buttons, links and tabs with these words; on the cards of the step's slots, if there are any.
  function named(word, places) {
    const all = [...document.querySelectorAll("button, a, .q-tab, [role=button]:not([data-slot])")];
    const found = all.filter((one) => outside(one) && shown(one) && wordsOf(one) === word.toLowerCase());
    const near = found.filter((one) => places.some((place) => place.contains(one)) || one.closest(".ms-drawer"));
    const onCards = found.filter((one) => one.matches(".plug"));
    return (near.length ? near : found.filter((one) => !onCards.includes(one))).slice(0, MOST);
  }

  function targets() {
    const cards = wanted.slots.map((slot) => document.querySelector(`[data-slot="${CSS.escape(slot)}"]`)).filter(Boolean);
    const places = cards.map((card) => card.parentElement);
    const ports = wanted.ports.map((port) => document.querySelector(`g.port[data-port="${CSS.escape(port)}"]`)).filter(Boolean);
    const topics = new Set(ports.map((port) => port.dataset.topic).filter(Boolean));
    const wires = wanted.isWire ? [...document.querySelectorAll("g.wire")].filter((one) => topics.has(one.dataset.line)) : [];
    return [...wanted.words.flatMap((word) => named(word, places)), ...places, ...(wanted.isWire ? ports : []), ...wires];
  }

  function look() {
    if (!wanted) return;
    const found = new Set(targets());
    for (const one of document.querySelectorAll(".ms-pointed")) if (!found.has(one)) one.classList.remove("ms-pointed");
    for (const one of found) one.classList.add("ms-pointed");
    if (isNew && found.size) {
      isNew = false;
      const inside = [...found].filter((one) => one.closest("#content"));
      const fits = (one) => one.getBoundingClientRect().height <= end() - HEAD_PX;
      const first = inside.find((one) => one.matches(".place") && fits(one)) || inside[0];
      if (first) uncover(first);
    }
  }

  // Above a sheet or strip, below the header and the time slider that sticks there: else the page scrolls.
  function uncover(one) {
    const box = one.getBoundingClientRect();
    if (box.top >= HEAD_PX && box.bottom <= end()) return;
    scrollBy({ top: box.top - HEAD_PX - Math.max(0, (end() - HEAD_PX - box.height) / 2) });
  }

  // Where the page ends: at the lesson, if that is below.
  function end() {
    const lesson = document.querySelector(".ms-lesson").getBoundingClientRect();
    return lesson.left > 0 ? innerHeight : lesson.top;
  }

  function point(step) {
    if (JSON.stringify(step) === JSON.stringify(wanted)) return;
    wanted = step;
    isNew = true;
    look();
  }

  function stop() {
    wanted = null;
    heights.disconnect();
    document.body.style.removeProperty("--below");
    for (const one of document.querySelectorAll(".ms-pointed")) one.classList.remove("ms-pointed");
  }

  function fold(button) {
    const isFolded = !button.closest(".ms-lesson").classList.contains("folded");
    setFolded(button.closest(".ms-lesson"), isFolded);
    isNew = true;
    look();
    try { sessionStorage.setItem(place(), isFolded ? "1" : "0"); } catch { /* it is forgotten then */ }
  }

  function setFolded(aside, isFolded) {
    aside.classList.toggle("folded", isFolded);
    aside.querySelector(".ms-lesson-fold").setAttribute("aria-expanded", String(!isFolded));
    dispatchEvent(new Event("resize"));  // blocks measure their room
  }

  const isAtProgram = () => location.pathname.endsWith("/program");

  // A program needs the room that other pages have for the lesson.
  const place = () => (isAtProgram() ? "msbot-lesson-folded-at-program" : "msbot-lesson-folded");

  // A phone begins with the strip, and so does a program; afterwards it is as the person had it last.
  function foldAsKept(aside) {
    let kept = null;
    try { kept = sessionStorage.getItem(place()); } catch { /* as if there were none */ }
    setFolded(aside, kept === null ? innerWidth <= (isAtProgram() ? WIDE_PX : PHONE_PX) : kept === "1");
  }

  // A drawer that is open keeps the keyboard to itself; answers are written here.
  function begin(id) {
    const aside = document.getElementById(id);
    if (!aside) return;
    foldAsKept(aside);
    aside.addEventListener("focusin", (event) => event.stopPropagation());
    heights.disconnect();
    heights.observe(aside);
  }

  // Pages and drawers end where the lesson begins.
  const heights = new ResizeObserver(([seen]) => {
    document.body.style.setProperty("--below", `${Math.ceil(seen.borderBoxSize[0].blockSize)}px`);
  });

  // A device that is turned has another place for the lesson; a keyboard on the screen changes the height only.
  let width = innerWidth;
  addEventListener("resize", () => {
    if (innerWidth === width) return;
    width = innerWidth;
    const aside = document.querySelector(".ms-lesson");
    if (!aside) return;
    foldAsKept(aside);
    isNew = true;
    look();
  });

  async function copy(button) {
    const code = button.closest(".ms-code").querySelector("code").innerText;
    try {
      await navigator.clipboard.writeText(code);
    } catch {  // without TLS a browser has no clipboard for pages
      const field = document.createElement("textarea");
      field.value = code;
      document.body.append(field);
      field.select();
      document.execCommand("copy");
      field.remove();
    }
  }

  setInterval(look, LOOK_MS);
  return { point, stop, fold, begin, copy };
})();

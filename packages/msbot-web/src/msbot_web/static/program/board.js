// A board with MicroPython at a USB port of whoever looks at the page: Web Serial, and MicroPython's raw REPL.
// Nothing here knows the page: what goes wrong is thrown as a BoardError whose `word` the page has a sentence for.

class BoardError extends Error {
  constructor(word, detail = "") {
    super(word);
    this.word = word;
    this.detail = detail;
  }
}

const msbotBoard = (() => {
  const BAUDRATE = 115200, ANSWER_MS = 5000, TRIES = 2, CHUNK = 768, PIECE = 256, PIECE_MS = 10, MOST_HELD = 1 << 16, LONGEST_MS = 20000;
  const OLDEST = [1, 22];
  const text = (octets) => new TextDecoder().decode(octets);
  const octetsOf = (words) => new TextEncoder().encode(words);
  const quote = (words) => JSON.stringify(words); // a path in Python: ASCII names only, see `name`
  const pause = (ms) => new Promise((done) => setTimeout(done, ms));

  const FACTS = `
import sys, os
_i = sys.implementation
print(_i[0], _i[1][0], _i[1][1], getattr(_i, "_mpy", 0) & 255)
print(([p for p in sys.path if p.endswith("/lib")] or [os.getcwd().rstrip("/") + "/lib"])[0])
print(os.getcwd().rstrip("/"))
try:
 _v = os.statvfs(os.getcwd())
 print(_v[3] * (_v[1] or _v[0]), _v[1] or _v[0])
except (AttributeError, OSError):
 print(-1, 1)
`;
  const LOOK = (folder) => `
import os
from hashlib import sha256
try:
 _n = list(os.ilistdir(${quote(folder || "/")}))
except OSError:
 _n = ()
for _f in _n:
 if not _f[1] & 0x4000:
  _p = ${quote(folder)} + "/" + _f[0]
  _h = sha256()
  with open(_p, "rb") as _s:
   while 1:
    _b = _s.read(256)
    if not _b:
     break
    _h.update(_b)
  print(_h.digest().hex(), os.stat(_p)[6], _f[0])
`;

  class Board {
    constructor(port) {
      this.port = port;
      this.held = new Uint8Array(0);
      this.wake = () => {};
      this.isGone = false;
      this.onPrint = null;
    }

    async open() {
      try {
        await this.port.open({ baudRate: BAUDRATE, bufferSize: 8192 });
      } catch (error) {
        throw new BoardError("busy", error.message);
      }
      this.reader = this.port.readable.getReader();
      this.writer = this.port.writable.getWriter();
      this.pump = this.read();
    }

    async read() {
      try {
        for (;;) {
          const { value, done } = await this.reader.read();
          if (done) break;
          if (this.onPrint) this.onPrint(value);
          else if (this.held.length <= MOST_HELD) {
            const both = new Uint8Array(this.held.length + value.length);
            both.set(this.held);
            both.set(value, this.held.length);
            this.held = both;
          }
          this.wake();
        }
      } catch {
        // unplugged: whoever waits is told below
      }
      this.isGone = true;
      this.wake();
    }

    async write(octets) {
      if (this.isGone) throw new BoardError("unplugged");
      try {
        await this.writer.write(typeof octets === "string" ? octetsOf(octets) : octets);
      } catch {
        throw new BoardError("unplugged");
      }
    }

    // Octets up to and with `ending`; who talks without end is no board.
    async until(ending, ms = ANSWER_MS) {
      const wanted = octetsOf(ending), latest = performance.now() + LONGEST_MS;
      let searched = 0;
      for (;;) {
        const at = find(this.held, wanted, searched);
        if (at >= 0) return this.take(at + wanted.length);
        if (performance.now() > latest || this.held.length > MOST_HELD) throw new BoardError("garbage", text(this.held.slice(-60)));
        searched = Math.max(0, this.held.length - wanted.length);
        await this.more(ms);
      }
    }

    async count(number, ms = ANSWER_MS) {
      while (this.held.length < number) await this.more(ms);
      return this.take(number);
    }

    take(number) {
      const found = this.held.slice(0, number);
      this.held = this.held.slice(number);
      return found;
    }

    async more(ms) {
      if (this.isGone) throw new BoardError("unplugged");
      const before = this.held.length;
      const came = new Promise((done) => { this.wake = () => done(true); });
      const isSilent = !(await Promise.race([came, pause(ms).then(() => false)])) && this.held.length === before;
      if (isSilent) throw new BoardError(before ? "garbage" : "silent", text(this.held.slice(-60)));
    }

    // End what runs, and restart Python, so that all its memory is free.
    async enter() {
      let heard = null; // what one try has heard, the next one does not hear again
      for (let left = TRIES; ; left -= 1) {
        try {
          await this.write("\r\x03\x03");
          await pause(100);
          this.held = new Uint8Array(0);
          await this.write("\r\x01");
          await this.until("raw REPL; CTRL-B to exit\r\n>");
          await this.write("\x04");
          await this.until("soft reboot\r\n");
          await this.until("raw REPL; CTRL-B to exit\r\n>");
          this.canPaste = true;
          return;
        } catch (error) {
          heard = error.word === "garbage" ? error : heard;
          if (left <= 1 || error.word === "unplugged") throw error.word === "silent" && heard ? heard : error;
        }
      }
    }

    async exec(code) {
      const octets = octetsOf(code);
      if (!(this.canPaste && (await this.paste(octets)))) {
        for (let at = 0; at < octets.length; at += PIECE) {
          await this.write(octets.slice(at, at + PIECE));
          await pause(PIECE_MS);
        }
        await this.write("\x04");
        if (text(await this.count(2)) !== "OK") throw new BoardError("garbage", text(this.held));
      }
      const printed = text(await this.until("\x04")).slice(0, -1);
      const error = text(await this.until("\x04")).slice(0, -1);
      await this.until(">");
      if (error) throw new BoardError(/OSError: (28|\[Errno 28\])|ENOSPC/.test(error) ? "full" : "failed", error.trim().split("\n").pop());
      return printed.replace(/\r/g, "");
    }

    // Raw paste: the board says how much it takes, and when it takes more.
    async paste(octets) {
      await this.write("\x05A\x01");
      const answer = text(await this.count(2));
      if (answer !== "R\x01") {
        this.canPaste = false;
        if (answer !== "R\x00") await this.until("w REPL; CTRL-B to exit\r\n>");
        return false;
      }
      const [low, high] = await this.count(2), window = low | (high << 8);
      let room = window;
      for (let at = 0; at < octets.length; ) {
        while (room === 0 || this.held.length) {
          const [sign] = await this.count(1);
          if (sign === 1) room += window;
          else if (sign === 4) return (await this.write("\x04")), true; // it has read enough to know that it is wrong
          else throw new BoardError("garbage", text(this.held));
        }
        const piece = octets.slice(at, at + room);
        await this.write(piece);
        at += piece.length;
        room -= piece.length;
      }
      await this.write("\x04");
      await this.until("\x04");
      return true;
    }

    async facts() {
      const [what, lib, home, space] = (await this.exec(FACTS)).trim().split("\n");
      const [name, major, minor, mpy] = what.split(" ");
      if (name !== "micropython") throw new BoardError("other", name);
      if (Number(major) < OLDEST[0] || (Number(major) === OLDEST[0] && Number(minor) < OLDEST[1])) {
        throw new BoardError("old", `${major}.${minor}`);
      }
      const [free, block] = space.split(" ").map(Number);
      return { mpy: Number(mpy), lib, home, free, block };
    }

    async files(folder) {
      const lines = (await this.exec(LOOK(folder))).split("\n").filter(Boolean);
      return new Map(lines.map((line) => [line.slice(65).split(" ").slice(1).join(" "), { hash: line.slice(0, 64), size: Number(line.slice(65).split(" ")[0]) }]));
    }

    async writeFile(path, octets, progress) {
      await this.exec(`_f = open(${quote(path)}, "wb")\n_w = _f.write\nfrom binascii import a2b_base64 as _a`);
      for (let at = 0; at < octets.length; at += CHUNK) {
        const piece = octets.slice(at, at + CHUNK);
        await this.exec(`_w(_a("${btoa(String.fromCharCode(...piece))}"))`);
        progress(piece.length);
      }
      await this.exec("_f.close()");
    }

    // Leave raw mode and start main.py; what is printed from now on goes to `onPrint`.
    async restart(onPrint) {
      await this.write("\r\x02");
      await this.until(">>> ");
      await this.write("\x04");
      await this.until("soft reboot\r\n");
      this.onPrint = onPrint;
      if (this.held.length) onPrint(this.take(this.held.length));
    }

    async close() {
      this.onPrint = null;
      try {
        await this.reader.cancel();
        this.reader.releaseLock();
        this.writer.releaseLock();
        await this.port.close();
      } catch {
        // it was unplugged
      }
    }
  }

  function find(octets, wanted, from) {
    for (let at = from; at + wanted.length <= octets.length; at += 1) {
      if (wanted.every((octet, place) => octets[at + place] === octet)) return at;
    }
    return -1;
  }

  const hexOf = (buffer) => Array.from(new Uint8Array(buffer), (octet) => octet.toString(16).padStart(2, "0")).join("");
  const plain = (base64) => Uint8Array.from(atob(base64), (char) => char.charCodeAt(0));

  // A name that every file system takes, and that no program of the board itself has.
  const nameOnBoard = (name) => {
    const safe = name.replace(/[^A-Za-z0-9_.-]/g, "_");
    return ["main.py", "boot.py"].includes(safe) ? `my_${safe}` : safe;
  };

  // Everything that a board needs for a program. `tell(done, all)` hears how far it is.
  async function put(board, { program, name, settings, packageFiles, tell }) {
    await board.enter();
    const facts = await board.facts();
    const folder = `${facts.lib}/msbot`, known = await board.files(folder), mine = await board.files(facts.home);
    const wanted = await packageFiles(facts.mpy), todo = [];
    let need = 0;
    const blocks = (size) => Math.ceil(size / facts.block);
    const consider = (path, octets, hash, old) => {
      if (old && old.hash === hash) return;
      todo.push([path, octets]);
      need += blocks(octets.length) - (old ? blocks(old.size) : 0);
    };
    for (const [file, [hash, content, isGeneric]] of Object.entries(wanted)) {
      if (isGeneric && !known.has(file)) continue; // a generic board's: kept up to date where it is
      consider(`${folder}/${file}`, plain(content), hash, known.get(file));
    }
    const gone = [...known.keys()].filter((file) => !(file in wanted));
    for (const file of gone) need -= blocks(known.get(file).size);
    const kept = nameOnBoard(name);
    const own = { [kept]: program, "main.py": `import msbot\n\nmsbot.start(${quote(kept)})\n` };
    if (settings) {
      let before = {};
      if (mine.has("msbot.json")) {
        try {
          before = JSON.parse(await board.exec(`print(open(${quote(`${facts.home}/msbot.json`)}).read())`));
        } catch (error) {
          if (error instanceof BoardError && error.word !== "failed") throw error; // what is no JSON is written anew
        }
      }
      own["msbot.json"] = JSON.stringify({ ...before, ...settings }) + "\n";
    } else if (!mine.has("msbot.json")) throw new BoardError("noWay");
    for (const [file, words] of Object.entries(own)) {
      const octets = octetsOf(words);
      const hash = hexOf(await crypto.subtle.digest("SHA-256", octets));
      consider(`${facts.home}/${file}`, octets, hash, mine.get(file));
    }
    if (facts.free >= 0 && need * facts.block > facts.free) throw new BoardError("noSpace", `${Math.ceil((need * facts.block - facts.free) / 1024)}`);
    const all = todo.reduce((sum, [, octets]) => sum + octets.length, 0);
    let done = 0;
    for (const file of gone) await board.exec(`import os\nos.remove(${quote(`${folder}/${file}`)})`);
    for (const path of [facts.lib, folder]) await board.exec(`import os\ntry:\n os.stat(${quote(path)})\nexcept OSError:\n os.mkdir(${quote(path)})`);
    for (const [path, octets] of todo) await board.writeFile(path, octets, (count) => tell((done += count), all));
    return { written: todo.map(([path]) => path), octets: all, name: kept };
  }

  return { Board, put, isThere: () => "serial" in navigator };
})();

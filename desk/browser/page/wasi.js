// The calls that the program makes of its system (WASI, preview 1): it reads files that a person
// chose, writes one page, and reports lines. Of calls that are not here it hears that they are
// not supported.

const BAD_FILE = 8, INVALID = 28, MISSING = 44, UNSUPPORTED = 52;
const DIRECTORY = 3, DEVICE = 2, REGULAR = 4;
const CREATE = 1;
// The folder of all files; 0 to 2 are the standard streams.
const ROOT = 3;
// Bytes of a file that are read at once.
const PORTION = 1 << 20;

// Thrown by the call with which the program ends.
class Exit extends Error {
  constructor(code) {
    super(`ended with ${code}`);
    this.code = code;
  }
}

// A chosen file, read in portions: a file of gigabytes takes no more memory than a small one.
class Chosen {
  constructor(blob) {
    this.blob = blob;
    this.size = blob.size;
    this.at = 0;
    this.portion = new Uint8Array(0);
    this.portionAt = 0;
  }

  read(into) {
    const isHeld = this.at >= this.portionAt && this.at < this.portionAt + this.portion.length;
    if (!isHeld) {
      const slice = this.blob.slice(this.at, this.at + PORTION);
      this.portion = new Uint8Array(new FileReaderSync().readAsArrayBuffer(slice));
      this.portionAt = this.at;
    }
    const start = this.at - this.portionAt;
    const bytes = this.portion.subarray(start, start + into.length);
    into.set(bytes);
    this.at += bytes.length;
    return bytes.length;
  }
}

// A file that the program writes from beginning to end.
class Written {
  constructor() {
    this.parts = [];
    this.size = 0;
  }

  write(bytes) {
    this.parts.push(bytes.slice());
    this.size += bytes.length;
  }
}

// A stream of lines.
class Lines {
  constructor(take) {
    this.take = take;
    this.rest = '';
    this.decoder = new TextDecoder();
  }

  write(bytes) {
    const lines = (this.rest + this.decoder.decode(bytes, { stream: true })).split('\n');
    this.rest = lines.pop();
    lines.forEach(this.take);
  }
}

// The calls for a program with these arguments. `files`: blobs by their paths; `out` and `err`
// take lines; `memory` returns the program's memory. The written files are in `written`.
function system(args, files, out, err, memory) {
  const written = new Map();
  const open = new Map([[1, new Lines(out)], [2, new Lines(err)]]);
  let next = ROOT + 1;
  const view = () => new DataView(memory());
  const bytes = (at, length) => new Uint8Array(memory(), at, length);
  const text = (at, length) => new TextDecoder().decode(bytes(at, length).slice());
  const put32 = (at, value) => view().setUint32(at, value, true);
  const put64 = (at, value) => view().setBigUint64(at, BigInt(value), true);
  const strings = args.map((arg) => new TextEncoder().encode(`${arg}\0`));

  function* buffers(at, count) {
    for (let i = 0; i < count; i += 1) {
      yield bytes(view().getUint32(at + 8 * i, true), view().getUint32(at + 8 * i + 4, true));
    }
  }
  const kind = (fd) => (fd === ROOT ? DIRECTORY : fd < ROOT ? DEVICE : REGULAR);
  const exists = (fd) => fd <= ROOT || open.has(fd);
  function stat(at, type, size) {
    bytes(at, 64).fill(0);
    view().setUint8(at + 16, type);
    put64(at + 24, 1);
    put64(at + 32, size);
    return 0;
  }
  function each(fd, method, at, count, done) {
    const file = open.get(fd);
    if (!file || !file[method]) return BAD_FILE;
    let total = 0;
    for (const buffer of buffers(at, count)) {
      const moved = file[method](buffer) ?? buffer.length;
      total += moved;
      if (moved < buffer.length) break;
    }
    put32(done, total);
    return 0;
  }

  const calls = {
    args_sizes_get(count, size) {
      put32(count, strings.length);
      put32(size, strings.reduce((sum, string) => sum + string.length, 0));
      return 0;
    },
    args_get(pointers, at) {
      strings.forEach((string, index) => {
        put32(pointers + 4 * index, at);
        bytes(at, string.length).set(string);
        at += string.length;
      });
      return 0;
    },
    environ_sizes_get(count, size) {
      put32(count, 0);
      put32(size, 0);
      return 0;
    },
    environ_get: () => 0,
    clock_time_get(clock, precision, at) {
      const milliseconds = clock === 0 ? Date.now() : performance.now();
      put64(at, Math.round(milliseconds * 1e6));
      return 0;
    },
    random_get(at, length) {
      crypto.getRandomValues(bytes(at, length));
      return 0;
    },
    proc_exit(code) {
      throw new Exit(code);
    },
    fd_prestat_get(fd, at) {
      if (fd !== ROOT) return BAD_FILE;
      put32(at, 0);
      put32(at + 4, 1);
      return 0;
    },
    fd_prestat_dir_name(fd, at) {
      bytes(at, 1)[0] = 47;
      return 0;
    },
    fd_fdstat_get(fd, at) {
      if (!exists(fd)) return BAD_FILE;
      bytes(at, 24).fill(0);
      view().setUint8(at, kind(fd));
      view().setBigUint64(at + 8, ~0n, true);
      view().setBigUint64(at + 16, ~0n, true);
      return 0;
    },
    fd_filestat_get: (fd, at) => (exists(fd) ? stat(at, kind(fd), open.get(fd)?.size ?? 0) : BAD_FILE),
    path_filestat_get(fd, flags, path, length, at) {
      const file = files.get(text(path, length));
      return file ? stat(at, REGULAR, file.size) : MISSING;
    },
    path_open(fd, dirFlags, path, length, flags, rights, inherited, fdFlags, at) {
      const name = text(path, length);
      if (flags & CREATE) written.set(name, new Written());
      else if (!files.has(name)) return MISSING;
      open.set(next, flags & CREATE ? written.get(name) : new Chosen(files.get(name)));
      put32(at, next);
      next += 1;
      return 0;
    },
    fd_close: (fd) => (open.delete(fd) ? 0 : BAD_FILE),
    fd_read: (fd, at, count, done) => each(fd, 'read', at, count, done),
    fd_write: (fd, at, count, done) => each(fd, 'write', at, count, done),
    fd_seek(fd, offset, whence, at) {
      const file = open.get(fd);
      if (!(file instanceof Chosen)) return BAD_FILE;
      const place = Number(offset) + [0, file.at, file.size][whence];
      if (place < 0) return INVALID;
      file.at = place;
      put64(at, place);
      return 0;
    },
  };
  const imports = new Proxy(calls, { get: (known, name) => known[name] ?? (() => UNSUPPORTED) });
  return { imports, written };
}

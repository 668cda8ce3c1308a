// Where a page keeps recordings: in the browser's own file system for this page (OPFS), which survives a reload; in memory
// where the browser has none, as for a page that was opened from disk.

/** A file that grows. */
export interface Growing {
  write(bytes: Uint8Array): void;
  /** Makes the written bytes safe. */
  flush(): void;
  close(): void;
}
export interface Store {
  readonly isLasting: boolean; // a reload keeps the files
  names(): Promise<string[]>;
  create(name: string): Promise<Growing>;
  read(name: string): Promise<Blob>;
  remove(name: string): Promise<void>;
  /** The text that was kept by this name; null: none was. Empty if it cannot be read, or was not written whole. */
  kept(name: string): Promise<string | null>;
  /** Keeps a small text, also over a reload; null: forgets it. Calls take effect in their order. */
  keep(name: string, text: string | null): Promise<void>;
}
/** Of a file in a worker; the types for a window do not have it. */
interface SyncFile {
  truncate(size: number): void;
  write(bytes: Uint8Array, options: { at: number }): number;
  flush(): void;
  close(): void;
}
type Handle = FileSystemFileHandle & { createSyncAccessHandle(): Promise<SyncFile> };
const FOLDER = "wirebond recordings";
const PROBE = ".probe";
const USED_EVERY = 60_000; // ms

async function openFolder(): Promise<FileSystemDirectoryHandle> {
  const root = await navigator.storage.getDirectory();
  return root.getDirectoryHandle(FOLDER, { create: true });
}

export async function openStore(): Promise<Store> {
  try {
    const folder = await openFolder();
    const probe = (await folder.getFileHandle(PROBE, { create: true })) as Handle;
    (await probe.createSyncAccessHandle()).close();
    return new Files(folder);
  } catch {
    return new Memory();
  }
}

class Files implements Store {
  readonly isLasting = true;
  private keeping: Promise<void> = Promise.resolve();

  /** Chromium 156 forgets the folders of an Incognito window that it has not looked up for 10 minutes. A recording that is
   * written does not count. So the store looks something up every minute. */
  constructor(private folder: FileSystemDirectoryHandle) {
    setInterval(() => void this.folder.getFileHandle(PROBE, { create: true }).catch(() => {}), USED_EVERY);
  }

  /** Throws an `Error` with a sentence, once, if the folder was deleted with all recordings. */
  async names(): Promise<string[]> {
    const found: string[] = [];
    try {
      for await (const name of this.folder.keys()) if (!name.startsWith(".")) found.push(name);
    } catch (error) {
      if ((error as Error).name !== "NotFoundError") throw error;
      this.folder = await openFolder();
      throw new Error(
        "the browser has deleted the recordings of this page, as it does when site data is cleared; record again, and " +
          "download what you want to keep",
      );
    }
    return found;
  }

  async create(name: string): Promise<Growing> {
    const file = (await this.folder.getFileHandle(name, { create: true })) as Handle;
    const handle = await file.createSyncAccessHandle();
    handle.truncate(0);
    let at = 0;
    return {
      write: (bytes) => {
        const written = handle.write(bytes, { at });
        at += written;
        if (written < bytes.length) throw new Error("the browser has no more space for this page");
      },
      flush: () => handle.flush(),
      close: () => handle.close(),
    };
  }

  async read(name: string): Promise<Blob> {
    return (await this.folder.getFileHandle(name)).getFile();
  }

  remove(name: string): Promise<void> {
    return this.folder.removeEntry(name);
  }

  async kept(name: string): Promise<string | null> {
    try {
      return await (await this.read(`.${name}`)).text();
    } catch (error) {
      return (error as Error).name === "NotFoundError" ? null : "";
    }
  }

  keep(name: string, text: string | null): Promise<void> {
    this.keeping = this.keeping.catch(() => {}).then(() => this.write(`.${name}`, text));
    return this.keeping;
  }

  private async write(name: string, text: string | null): Promise<void> {
    if (text === null) {
      await this.remove(name).catch(() => {});
      return;
    }
    const file = await this.create(name); // from here on it exists, whatever happens to its text
    try {
      file.write(new TextEncoder().encode(text));
      file.flush();
    } finally {
      file.close();
    }
  }
}

class Memory implements Store {
  readonly isLasting = false;
  private readonly files = new Map<string, Uint8Array<ArrayBuffer>[]>();
  private readonly texts = new Map<string, string>();

  names(): Promise<string[]> {
    return Promise.resolve([...this.files.keys()]);
  }

  create(name: string): Promise<Growing> {
    const parts: Uint8Array<ArrayBuffer>[] = [];
    this.files.set(name, parts);
    return Promise.resolve({ write: (bytes) => void parts.push(bytes.slice()), flush: () => {}, close: () => {} });
  }

  read(name: string): Promise<Blob> {
    const parts = this.files.get(name);
    return parts ? Promise.resolve(new Blob(parts)) : Promise.reject(new Error(`there is no recording ${name}`));
  }

  remove(name: string): Promise<void> {
    this.files.delete(name);
    return Promise.resolve();
  }

  kept(name: string): Promise<string | null> {
    return Promise.resolve(this.texts.get(name) ?? null);
  }

  keep(name: string, text: string | null): Promise<void> {
    if (text === null) this.texts.delete(name);
    else this.texts.set(name, text);
    return Promise.resolve();
  }
}

// The real program on a database file of its own and a port of the system's choice.
import { spawn } from "node:child_process";
import { mkdtemp, rm } from "node:fs/promises";
import { tmpdir } from "node:os";
import path from "node:path";
import { createInterface } from "node:readline";

const root = path.resolve(import.meta.dirname, "../..");
const target = process.env.CARGO_TARGET_DIR ?? path.join(root, "target");

/** The program as the tests build it. */
export const program = path.join(target, "debug/riskaware");

export class Server {
  /** @param {string[]} args more arguments for `serve` */
  static async start(args = []) {
    const folder = await mkdtemp(path.join(tmpdir(), "riskaware-"));
    const database = path.join(folder, "riskaware.db");
    const server = new Server(folder, database, args);
    await server.run();
    return server;
  }

  constructor(folder, database, args) {
    Object.assign(this, { folder, database, args });
  }

  async run(port = 0) {
    this.process = spawn(
      program,
      ["serve", "--listen", `127.0.0.1:${port}`, "--database", this.database, ...this.args],
      { stdio: ["ignore", "pipe", "inherit"], env: { ...process.env, RISKAWARE_LOG: "warn" } },
    );
    for await (const line of createInterface({ input: this.process.stdout })) {
      const found = line.match(/http:\/\/127\.0\.0\.1:(\d+)/);
      if (found) {
        this.port ??= Number(found[1]);
        this.url ??= found[0];
      }
      this.setupLink = line.match(/http:\S+\/setup\/\S+/)?.[0] ?? this.setupLink;
      // The last line says who may see results.
      if (this.url && /^ {2}Results /.test(line)) return;
    }
    throw new Error("the server ended before it printed its address");
  }

  /** Kills without warning and starts again on the same file and port. */
  async restart() {
    await this.end("SIGKILL");
    await this.run(this.port);
  }

  async stop() {
    await this.end("SIGTERM");
    await rm(this.folder, { recursive: true });
  }

  end(signal) {
    return new Promise((resolve) => {
      this.process.once("exit", resolve);
      this.process.kill(signal);
    });
  }
}

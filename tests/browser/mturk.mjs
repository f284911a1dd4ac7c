// Plays MTurk: a page that shows a study in a frame, and the address that takes finished assignments and leads on to another
// host, as MTurk has one for requesters and one for workers.
import { once } from "node:events";
import { createServer } from "node:http";

export class Mturk {
  /** What was handed in, one entry per assignment. @type {Record<string, string>[]} */
  handedIn = [];
  /** The cookies that browsers sent here, to show that they send none. @type {(string | undefined)[]} */
  cookies = [];

  static async start() {
    const mturk = new Mturk();
    mturk.server = createServer((request, response) => mturk.answer(request, response));
    mturk.server.listen(0, "127.0.0.1");
    await once(mturk.server, "listening");
    // Another host name than the study's 127.0.0.1: a site of its own for browsers.
    const { port } = mturk.server.address();
    mturk.url = `http://localhost:${port}`;
    mturk.workersUrl = `http://worker.localhost:${port}`;
    return mturk;
  }

  /** Shows the study at this address to a worker, as MTurk appends its parameters. */
  shows(study) {
    this.study = study;
  }

  async answer(request, response) {
    this.cookies.push(request.headers.cookie);
    const { pathname } = new URL(request.url, this.url);
    response.setHeader("content-type", "text/html; charset=utf-8");
    response.setHeader("set-cookie", "mturk=here; Path=/");
    if (request.method === "POST" && pathname === "/mturk/externalSubmit") {
      let body = "";
      for await (const chunk of request) body += chunk;
      this.handedIn.push(Object.fromEntries(new URLSearchParams(body)));
      response.writeHead(302, { location: `${this.workersUrl}/done` }).end();
      return;
    }
    if (pathname === "/done") {
      response.end("<!doctype html><title>MTurk</title><h1>Handed in</h1>");
      return;
    }
    const parameters = pathname === "/look"
      ? { assignmentId: "ASSIGNMENT_ID_NOT_AVAILABLE", hitId: "H1", turkSubmitTo: this.url }
      : { assignmentId: `assignment-${pathname.slice(1)}`, hitId: "H1", workerId: pathname.slice(1), turkSubmitTo: this.url };
    const address = `${this.study}?${new URLSearchParams(parameters)}`.replaceAll("&", "&amp;");
    response.end(`<!doctype html><title>MTurk</title><meta name="viewport" content="width=device-width">
      <h1>A HIT</h1><iframe src="${address}" width="100%" height="700"></iframe>`);
  }

  async stop() {
    this.server.closeAllConnections();
    await new Promise((resolve) => this.server.close(resolve));
  }
}

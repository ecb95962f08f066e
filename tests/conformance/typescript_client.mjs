// The official TypeScript SDK as a client, in node and in a browser. It does what it is told and tells what it hears; it
// judges nothing: the test that drives it does.
//
// In node, commands come as lines of JSON on stdin and events go to stdout:
//   node --experimental-websocket typescript_client.mjs ws://HOST:PORT/acp TOKEN
// In a browser, `begin` is a global, and the page passes both on.
//
// Commands: {id, method, params} is a request, {method, params} a notification, {question, optionId} an answer.
// Events:   {id, result} or {id, error}, {heard: params of session/update}, {question, params}, {withdrawn: question}.
import { client, methods } from "../../web/node_modules/@agentclientprotocol/sdk/dist/v1/stable/acp.js";
import { createWebSocketStream } from "../../web/node_modules/@agentclientprotocol/sdk/dist/transports/ws-stream.js";

/** Connect, and return the function that carries out a command. */
export function begin(address, token, tell) {
  const answers = [];

  const app = client({ name: "robot-acp conformance" })
    .onNotification(methods.client.session.update, ({ params }) => tell({ heard: params }))
    .onRequest(methods.client.session.requestPermission, ({ params, signal }) => {
      return new Promise((resolve) => {
        const question = answers.push((outcome) => resolve({ outcome })) - 1;
        signal.addEventListener("abort", () => {
          tell({ withdrawn: question });
          resolve({ outcome: { outcome: "cancelled" } });
        });
        tell({ question, params });
      });
    });

  const stream = createWebSocketStream(address, { protocols: ["acp.v1", `bearer.${token}`] });
  const connected = new Promise((resolve, reject) => {
    // The connection lasts as long as what is returned here: until the process or the page ends.
    app.connectWith(stream, (agent) => (resolve(agent), new Promise(() => undefined))).catch(reject);
  });

  return async ({ id, method, params, question, optionId }) => {
    const agent = await connected;
    if (question !== undefined) answers[question]({ outcome: "selected", optionId });
    else if (id === undefined) await agent.notify(method, params);
    else {
      try {
        tell({ id, result: await agent.request(method, params) });
      } catch (error) {
        tell({ id, error: String(error) });
      }
    }
  };
}

if (globalThis.process?.stdin === undefined) {
  globalThis.begin = begin;
} else {
  const [address, token] = process.argv.slice(2);
  const obey = begin(address, token, (event) => process.stdout.write(`${JSON.stringify(event)}\n`));
  let rest = "";
  for await (const chunk of process.stdin.setEncoding("utf8")) {
    const lines = (rest + chunk).split("\n");
    rest = lines.pop();
    for (const line of lines) void obey(JSON.parse(line));
  }
  process.exit(0);
}

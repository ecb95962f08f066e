// The official TypeScript SDK as a client: the paper's session, P1 to P4, over the bridge's WebSocket. It prints what it
// heard as one JSON object, and judges nothing: the test that starts it does.
//
// node --experimental-websocket typescript_client.mjs ws://HOST:PORT/acp TOKEN
import { client, methods, PROTOCOL_VERSION } from "../../web/node_modules/@agentclientprotocol/sdk/dist/v1/stable/acp.js";
import { createWebSocketStream } from "../../web/node_modules/@agentclientprotocol/sdk/dist/transports/ws-stream.js";

const [address, token] = process.argv.slice(2);
const text = (sentence) => [{ type: "text", text: sentence }];

const heard = [];
const questions = [];
let answers = [];
let onUpdate = () => undefined;

const app = client({ name: "robot-acp conformance" })
  .onNotification(methods.client.session.update, ({ params }) => {
    heard.push(params);
    onUpdate(params.update);
  })
  .onRequest(methods.client.session.requestPermission, ({ params }) => {
    const optionId = answers.shift();
    questions.push({ title: params.toolCall.title, answer: optionId });
    return { outcome: { outcome: "selected", optionId } };
  });

const protocols = ["acp.v1", `bearer.${token}`];
const report = await app.connectWith(createWebSocketStream(address, { protocols }), async (agent) => {
  const hello = await agent.request(methods.agent.initialize, {
    protocolVersion: PROTOCOL_VERSION,
    clientInfo: { name: "robot-acp-conformance", version: "1" },
    clientCapabilities: {},
  });
  const { sessionId } = await agent.request(methods.agent.session.new, { cwd: "/", mcpServers: [] });
  const ask = async (sentence) =>
    (await agent.request(methods.agent.session.prompt, { sessionId, prompt: text(sentence) })).stopReason;

  const stopReasons = [];
  answers = ["allow_once"];
  stopReasons.push(await ask("Go to lab 2.3.7 and tell them that the meeting is at noon"));

  // Cancelled once the robot has told how far it still has to go.
  onUpdate = (update) => {
    if (update._meta?.["robot-acp/progress"] === undefined) return;
    onUpdate = () => undefined;
    void agent.notify(methods.agent.session.cancel, { sessionId });
  };
  stopReasons.push(await ask("Go back to where you started"));

  answers = ["reject_once", "allow_once"];
  const both = "tell them that it moved to one o'clock, and then tell them that lunch is at two";
  stopReasons.push(await ask(`Go to lab 2.3.7, ${both}`));
  stopReasons.push(await ask("Go back to where you started"));
  return { protocolVersion: hello.protocolVersion, sessionId, stopReasons, questions, heard };
});
process.stdout.write(JSON.stringify(report));
